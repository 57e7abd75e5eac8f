#include "processing/codecs/linear/sample_weights.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs {
namespace {

constexpr int kPointsPerDirection = 64, kMaxPoints = 40000;
constexpr double kLeastShare = 0.02;  // of the mean: no direction vanishes
constexpr double kTogether = 2e-3;     // rad: directions that are one, but for the encoders of the rig
constexpr double kVarianceFloor = 0.01;  // of the mean variance
constexpr double kFloorOfRms = 0.01, kWideFloorOfRms = 0.25;

// Mean squares of the BTF by texel and by (pair, channel), over what is present.
struct Energies {
  std::vector<double> texel, sample;
  double mean = 0;
};

Energies EnergiesOf(const btf::SampledBtf& btf) {
  const btf::BtfHeader& h = btf.header();
  const size_t texels = h.texel_count();
  Energies e{std::vector<double>(texels, 0.0),
             std::vector<double>(3 * h.views.size() * h.lights.size(), 0.0)};
  double values = 0;
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      const auto image = btf.Image(v, l);
      double* const of_pair = e.sample.data() + 3 * btf.PairIndex(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        const double square = static_cast<double>(image[i]) * static_cast<double>(image[i]);
        e.texel[i / 3] += square;
        of_pair[i % 3] += square;
      }
      for (size_t c = 0; c < 3; ++c) e.mean += of_pair[c];
      for (size_t c = 0; c < 3; ++c) of_pair[c] /= static_cast<double>(texels);
      values += static_cast<double>(image.size());
    }
  }
  e.mean /= std::max(values, 1.0);
  for (double& x : e.texel) x *= static_cast<double>(texels) / std::max(values, 1.0);
  return e;
}

}  // namespace

std::vector<double> SolidAngleWeights(const std::vector<Vec3>& directions) {
  const size_t n = directions.size();
  std::vector<double> weights(n, 1.0);
  if (n < 2) return weights;
  double lowest = 1;
  for (const Vec3& d : directions) lowest = std::min(lowest, Normalized(d).z);
  const int points = std::min<int>(kMaxPoints, kPointsPerDirection * static_cast<int>(n));
  std::fill(weights.begin(), weights.end(), 0.0);
  for (int i = 0; i < points; ++i) {  // a spiral of points of equal area
    const double z = 1 - (1 - lowest) * (i + 0.5) / points;
    const double r = std::sqrt(std::max(0.0, 1 - z * z)), phi = i * kPi * (3 - std::sqrt(5.0));
    const Vec3 p{r * std::cos(phi), r * std::sin(phi), z};
    size_t nearest = 0;
    double best = -2;
    for (size_t k = 0; k < n; ++k) {
      const double cosine = Dot(p, directions[k]);
      if (cosine > best) best = cosine, nearest = k;
    }
    weights[nearest] += static_cast<double>(n) / points;
  }
  // Which of directions that nearly coincide is nearest to a point is chance: they share evenly.
  std::vector<double> shared(n, 0.0);
  for (size_t i = 0; i < n; ++i) {
    double sum = 0, count = 0;
    for (size_t k = 0; k < n; ++k) {
      if (Norm(directions[i] - directions[k]) > kTogether) continue;
      sum += std::max(weights[k], 0.0), count += 1;
    }
    shared[i] = std::max(sum, kLeastShare) / count;
  }
  return shared;
}

namespace {

// Calls function(texel, pair, variance of what is fitted) for all that is present inside the mask.
template <typename Function>
void ForVariances(const btf::SampledBtf& btf, double log_floor, const Function& function) {
  const btf::BtfHeader& h = btf.header();
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      const auto variance = btf.Variance(v, l), image = btf.Image(v, l);
      for (size_t i = 0; i < variance.size(); ++i) {
        if (!h.InMask(i)) continue;
        double s = variance[i];
        if (log_floor > 0) {
          const double grey = (image[3 * i] + image[3 * i + 1] + image[3 * i + 2]) / 3.0;
          const double slope = std::max(grey, 0.0) + log_floor;
          s /= slope * slope;
        }
        function(i, btf.PairIndex(v, l), s);
      }
    }
  }
}

}  // namespace

VarianceWeights WeightsOfVariance(const btf::SampledBtf& btf, const EncodeOptions& options,
                                  double log_floor) {
  const btf::BtfHeader& h = btf.header();
  VarianceWeights w{std::vector<double>(h.texel_count(), 0.0),
                    std::vector<double>(h.views.size() * h.lights.size(), 0.0)};
  double sum = 0, count = 0;
  ForVariances(btf, log_floor, [&](size_t, size_t, double s) { sum += s, count += 1; });
  if (!(sum > 0)) return {std::vector<double>(w.texel.size(), 1.0), std::vector<double>(w.pair.size(), 1.0)};
  const double floor = options.floor > 0 && log_floor <= 0 ? options.floor * options.floor
                                                           : kVarianceFloor * sum / count;
  std::vector<double> of_texel(w.texel.size(), 0.0), of_pair(w.pair.size(), 0.0);
  double mean = 0;
  ForVariances(btf, log_floor, [&](size_t texel, size_t pair, double s) {
    const double log = -std::log(s + floor);
    w.texel[texel] += log, of_texel[texel] += 1;
    w.pair[pair] += log, of_pair[pair] += 1;
    mean += log / count;
  });
  const auto finish = [mean](std::vector<double>& logs, const std::vector<double>& counts) {
    for (size_t i = 0; i < logs.size(); ++i) {
      logs[i] = counts[i] > 0 ? std::exp(logs[i] / counts[i] - mean) : 1;
    }
  };
  finish(w.texel, of_texel);
  finish(w.pair, of_pair);
  return w;
}

bool WeighsPairs(const EncodeOptions& options) {
  return options.weighting == Weighting::kRelative || options.solid_angle || options.variance;
}

SampleWeights WeightsFor(const btf::SampledBtf& btf, const EncodeOptions& options,
                         double log_floor) {
  const btf::BtfHeader& h = btf.header();
  SampleWeights w{std::vector<float>(h.texel_count(), 1.0f),
                  std::vector<float>(3 * h.views.size() * h.lights.size(), 1.0f)};
  if (options.weighting != Weighting::kLinear) {
    const Energies e = EnergiesOf(btf);
    w.floor = options.floor > 0 ? options.floor : kFloorOfRms * std::sqrt(e.mean);
    if (w.floor <= 0) w.floor = 1;  // all is black
    if (options.weighting == Weighting::kRelative) {
      const double rms = std::sqrt(e.mean) + w.floor;
      for (size_t i = 0; i < e.texel.size(); ++i) {
        w.texel[i] = static_cast<float>(rms / (std::sqrt(e.texel[i]) + w.floor));
      }
      for (size_t i = 0; i < e.sample.size(); ++i) {
        w.sample[i] = static_cast<float>(rms / (std::sqrt(e.sample[i]) + w.floor));
      }
    }
  }
  for (size_t i = 0; i < w.texel.size(); ++i) {
    if (!h.InMask(i)) w.texel[i] *= kOutsideMask;
  }
  if (options.variance) {
    const VarianceWeights of =
        WeightsOfVariance(btf, options, options.weighting == Weighting::kLog ? w.floor : log_floor);
    for (size_t i = 0; i < w.texel.size(); ++i) {
      w.texel[i] *= static_cast<float>(std::sqrt(of.texel[i]));
    }
    for (size_t i = 0; i < w.sample.size(); ++i) {
      w.sample[i] *= static_cast<float>(std::sqrt(of.pair[i / 3]));
    }
  }
  if (!options.solid_angle) return w;
  const std::vector<double> views = SolidAngleWeights(h.views), lights = SolidAngleWeights(h.lights);
  for (size_t v = 0; v < views.size(); ++v) {
    for (size_t l = 0; l < lights.size(); ++l) {
      const auto root = static_cast<float>(std::sqrt(views[v] * lights[l]));
      for (size_t c = 0; c < 3; ++c) w.sample[3 * (v * lights.size() + l) + c] *= root;
    }
  }
  return w;
}

double WideFloor(const btf::SampledBtf& btf, const EncodeOptions& options) {
  if (options.floor > 0) return options.floor;
  const double mean = EnergiesOf(btf).mean;
  return mean > 0 ? kWideFloorOfRms * std::sqrt(mean) : 1;
}

SeparateWeights SeparateWeightsFor(const btf::SampledBtf& btf, const EncodeOptions& options) {
  const size_t views = btf.header().views.size(), lights = btf.header().lights.size();
  SampleWeights samples = WeightsFor(btf, options);
  SeparateWeights w{std::vector<float>(views, 1.0f), std::vector<float>(lights, 1.0f),
                    std::move(samples.texel), samples.floor};
  w.plain = !WeighsPairs(options) && btf.header().mask.empty();
  const auto fit = [&](std::vector<float>& to, size_t v_step, size_t l_step) {
    std::vector<double> sums(to.size(), 0.0), counts(to.size(), 0.0);
    for (size_t v = 0; v < views; ++v) {
      for (size_t l = 0; l < lights; ++l) {
        const size_t at = v * v_step + l * l_step;
        for (size_t c = 0; c < 3; ++c) {
          const double rest = samples.sample[3 * (v * lights + l) + c] / (w.view[v] * w.light[l]);
          sums[at] += 1 / (rest * rest);
          counts[at] += 1;
        }
      }
    }
    for (size_t i = 0; i < to.size(); ++i) to[i] = static_cast<float>(std::sqrt(counts[i] / sums[i]));
  };
  fit(w.view, 1, 0);
  fit(w.light, 0, 1);
  return w;
}

}  // namespace mesorig::codecs
