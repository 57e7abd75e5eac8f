#include "processing/assemble/merge_exposures.h"

#include <algorithm>

#include "processing/image/radiance.h"

namespace mesorig::assemble {
namespace {

// Of one value of one texel: frames that take part, by index.
double WeightedMean(std::span<const ExposedFrame> frames, std::span<const size_t> used, size_t k) {
  const size_t colour = k % 3;
  double electrons = 0, sensitivity = 0;
  for (const size_t f : used) {
    const ExposedFrame& frame = frames[f];
    const double seconds = frame.camera->electrons_per_radiance_s * frame.exposure_s;
    electrons += static_cast<double>(frame.values[k]) * frame.irradiance[colour] * seconds;
    sensitivity += seconds;
  }
  const double radiance = electrons / sensitivity;
  double sum = 0, weights = 0;
  for (const size_t f : used) {
    const ExposedFrame& frame = frames[f];
    const double weight = 1 / image::RadianceVariance(*frame.camera, radiance, frame.exposure_s);
    sum += weight * static_cast<double>(frame.values[k]);
    weights += weight;
  }
  return sum / weights;
}

}  // namespace

size_t MergeExposures(std::span<const ExposedFrame> frames, std::span<float> merged) {
  double shortest_s = frames[0].exposure_s;
  for (const ExposedFrame& frame : frames) shortest_s = std::min(shortest_s, frame.exposure_s);
  size_t bounds = 0;
  std::vector<size_t> used;
  for (size_t t = 0; t < merged.size() / 3; ++t) {
    used.clear();
    for (size_t f = 0; f < frames.size(); ++f) {
      if (frames[f].saturated[t] == 0) used.push_back(f);
    }
    if (used.empty()) {
      ++bounds;
      for (size_t f = 0; f < frames.size(); ++f) {
        if (frames[f].exposure_s == shortest_s) used.push_back(f);
      }
    }
    for (size_t k = 3 * t; k < 3 * t + 3; ++k) {
      merged[k] = static_cast<float>(WeightedMean(frames, used, k));
    }
  }
  return bounds;
}

}  // namespace mesorig::assemble
