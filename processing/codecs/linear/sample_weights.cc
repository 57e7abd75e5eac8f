#include "processing/codecs/linear/sample_weights.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "processing/codecs/algebra/threads.h"

namespace mesorig::codecs {
namespace {

constexpr int kPointsPerDirection = 64, kMaxPoints = 40000;
constexpr double kLeastShare = 0.02;  // of the mean: no direction vanishes
constexpr double kTogether = 2e-3;     // rad: directions that are one, but for the encoders of the rig
constexpr double kVarianceFloor = 0.01;  // of the mean variance
constexpr double kFloorOfRms = 0.01, kWideFloorOfRms = 0.25;

// As files store it, so that the order of a sum does not show.
double Stored(double floor) { return static_cast<float>(floor); }

// Mean squares of the BTF by texel and by (pair, channel), over what is present.
struct Energies {
  std::vector<double> texel, sample;
  double mean = 0;
};

StatusOr<Energies> EnergiesOf(const SampleSource& source, const EncodeOptions& options) {
  const std::vector<size_t> pairs = source.Pairs();
  const size_t texels = source.header().texel_count();
  Energies e{std::vector<double>(texels, 0.0), std::vector<double>(3 * source.present().size(), 0.0)};
  std::vector<std::vector<double>> of_workers(
      static_cast<size_t>(algebra::Threads()), std::vector<double>(e.sample.size(), 0.0));
  MESORIG_RETURN_IF_ERROR(ForSampleBlocks(
      source, options.block_bytes,
      [&](int worker, int64_t first, int64_t count, const float* samples) {
        double* const of_texel = e.texel.data() + first;
        for (size_t j = 0; j < 3 * pairs.size(); ++j, samples += count) {
          double sum = 0;
          for (int64_t i = 0; i < count; ++i) {
            const double square = static_cast<double>(samples[i]) * static_cast<double>(samples[i]);
            of_texel[i] += square;
            sum += square;
          }
          of_workers[static_cast<size_t>(worker)][3 * pairs[j / 3] + j % 3] += sum;
        }
        return OkStatus();
      }));
  const double values = std::max(3.0 * static_cast<double>(pairs.size() * texels), 1.0);
  for (const std::vector<double>& of_worker : of_workers) {
    for (size_t k = 0; k < e.sample.size(); ++k) {
      e.mean += of_worker[k] / values;
      e.sample[k] += of_worker[k] / static_cast<double>(texels);
    }
  }
  for (double& x : e.texel) x *= static_cast<double>(texels) / values;
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

// Sums over what is present inside the mask.
struct VarianceSums {
  double sum = 0, count = 0;
  std::vector<double> pair, of_pair;  // sums and counts
};

// Calls function(sums of the worker's own, texel, pair, variance of what is fitted) for all that is
// present inside the mask, all of a texel on one worker. The sums are added up.
template <typename Function>
StatusOr<VarianceSums> ForVariances(const SampleSource& source, const EncodeOptions& options,
                                    double log_floor, const Function& function) {
  const btf::BtfHeader& h = source.header();
  const std::vector<size_t> pairs = source.Pairs();
  const auto channels = static_cast<int64_t>(pairs.size()) * (log_floor > 0 ? 4 : 1);
  const BlockSizes blocks = BlocksOf(source, 4 * channels, options.block_bytes);
  const std::vector<double> zeros(source.present().size(), 0.0);
  std::vector<VarianceSums> sums(static_cast<size_t>(blocks.workers), {0, 0, zeros, zeros});
  const Status done = algebra::ForParts(
      blocks.workers, static_cast<int64_t>(h.texel_count()), blocks.texels,
      [&](int worker, int64_t first, int64_t count) -> Status {
        const auto n = static_cast<size_t>(count);
        std::vector<float> variances(pairs.size() * n), samples;
        MESORIG_RETURN_IF_ERROR(source.Variances(first, count, pairs, variances.data()));
        if (log_floor > 0) {
          samples.resize(3 * pairs.size() * n);
          MESORIG_RETURN_IF_ERROR(source.Columns(first, count, pairs, samples.data()));
        }
        for (size_t p = 0; p < pairs.size(); ++p) {
          for (size_t i = 0; i < n; ++i) {
            const size_t texel = static_cast<size_t>(first) + i;
            if (!h.InMask(texel)) continue;
            double s = variances[p * n + i];
            if (log_floor > 0) {
              const float* const rgb = samples.data() + 3 * p * n + i;
              const double slope = std::max((rgb[0] + rgb[n] + rgb[2 * n]) / 3.0, 0.0) + log_floor;
              s /= slope * slope;
            }
            function(sums[static_cast<size_t>(worker)], texel, pairs[p], s);
          }
        }
        return OkStatus();
      });
  MESORIG_RETURN_IF_ERROR(done);
  for (size_t w = 1; w < sums.size(); ++w) {
    sums[0].sum += sums[w].sum, sums[0].count += sums[w].count;
    const auto add = [](std::vector<double>& to, const std::vector<double>& from) {
      std::transform(to.begin(), to.end(), from.begin(), to.begin(), std::plus<double>());
    };
    add(sums[0].pair, sums[w].pair), add(sums[0].of_pair, sums[w].of_pair);
  }
  return std::move(sums[0]);
}

}  // namespace

StatusOr<VarianceWeights> WeightsOfVariance(const SampleSource& source, const EncodeOptions& options,
                                            double log_floor) {
  MESORIG_ASSIGN_OR_RETURN(
      const VarianceSums all,
      ForVariances(source, options, log_floor, [](VarianceSums& sums, size_t, size_t, double s) {
        sums.sum += s, sums.count += 1;
      }));
  const size_t texels = source.header().texel_count(), pairs = source.present().size();
  if (!(all.sum > 0)) {
    return VarianceWeights{std::vector<double>(texels, 1.0), std::vector<double>(pairs, 1.0)};
  }
  const double floor = options.floor > 0 && log_floor <= 0 ? options.floor * options.floor
                                                           : kVarianceFloor * all.sum / all.count;
  std::vector<double> of_texel(texels, 0.0), counts_of_texel(texels, 0.0);
  MESORIG_ASSIGN_OR_RETURN(
      VarianceSums logs,
      ForVariances(source, options, log_floor,
                   [&, floor](VarianceSums& sums, size_t texel, size_t pair, double s) {
                     const double log = -std::log(s + floor);
                     of_texel[texel] += log, counts_of_texel[texel] += 1;
                     sums.pair[pair] += log, sums.of_pair[pair] += 1;
                     sums.sum += log;
                   }));
  const double mean = logs.sum / all.count;
  const auto finish = [mean](std::vector<double>& sums, const std::vector<double>& counts) {
    for (size_t i = 0; i < sums.size(); ++i) {
      sums[i] = counts[i] > 0 ? std::exp(sums[i] / counts[i] - mean) : 1;
    }
  };
  finish(of_texel, counts_of_texel);
  finish(logs.pair, logs.of_pair);
  return VarianceWeights{std::move(of_texel), std::move(logs.pair)};
}

bool WeighsPairs(const EncodeOptions& options) {
  return options.weighting == Weighting::kRelative || options.solid_angle || options.variance;
}

StatusOr<SampleWeights> WeightsFor(const SampleSource& source, const EncodeOptions& options,
                                   double log_floor) {
  const btf::BtfHeader& h = source.header();
  SampleWeights w{std::vector<float>(h.texel_count(), 1.0f),
                  std::vector<float>(3 * h.views.size() * h.lights.size(), 1.0f)};
  const bool relative = options.weighting == Weighting::kRelative;
  if (options.weighting != Weighting::kLinear) w.floor = options.floor;
  if (relative || (options.weighting == Weighting::kLog && options.floor <= 0)) {
    MESORIG_ASSIGN_OR_RETURN(const Energies e, EnergiesOf(source, options));
    if (w.floor <= 0) w.floor = Stored(kFloorOfRms * std::sqrt(e.mean));
    if (w.floor <= 0) w.floor = 1;  // all is black
    const double rms = std::sqrt(e.mean) + w.floor;
    for (size_t i = 0; relative && i < e.texel.size(); ++i) {
      w.texel[i] = static_cast<float>(rms / (std::sqrt(e.texel[i]) + w.floor));
    }
    for (size_t i = 0; relative && i < e.sample.size(); ++i) {
      w.sample[i] = static_cast<float>(rms / (std::sqrt(e.sample[i]) + w.floor));
    }
  }
  for (size_t i = 0; i < w.texel.size(); ++i) {
    if (!h.InMask(i)) w.texel[i] *= kOutsideMask;
  }
  if (options.variance) {
    MESORIG_ASSIGN_OR_RETURN(
        const VarianceWeights of,
        WeightsOfVariance(source, options,
                          options.weighting == Weighting::kLog ? w.floor : log_floor));
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

StatusOr<double> WideFloor(const SampleSource& source, const EncodeOptions& options) {
  if (options.floor > 0) return options.floor;
  MESORIG_ASSIGN_OR_RETURN(const Energies e, EnergiesOf(source, options));
  return e.mean > 0 ? Stored(kWideFloorOfRms * std::sqrt(e.mean)) : 1;
}

StatusOr<SeparateWeights> SeparateWeightsFor(const SampleSource& source,
                                             const EncodeOptions& options) {
  const btf::BtfHeader& h = source.header();
  MESORIG_ASSIGN_OR_RETURN(SampleWeights samples, WeightsFor(source, options));
  SeparateWeights w = NearestProduct(std::move(samples), h.views.size(), h.lights.size());
  w.plain = !WeighsPairs(options) && h.mask.empty();
  return w;
}

SeparateWeights NearestProduct(SampleWeights samples, size_t views, size_t lights) {
  SeparateWeights w{std::vector<float>(views, 1.0f), std::vector<float>(lights, 1.0f),
                    std::move(samples.texel), samples.floor, /*plain=*/false};
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

SampleWeights Product(const SeparateWeights& w) {
  SampleWeights product{w.texel, {}, w.floor};
  for (const float view : w.view) {
    for (const float light : w.light) product.sample.insert(product.sample.end(), 3, view * light);
  }
  return product;
}

}  // namespace mesorig::codecs
