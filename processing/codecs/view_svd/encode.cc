#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "processing/codecs/linear/linear_encoder.h"
#include "processing/codecs/view_svd/factorise.h"
#include "processing/codecs/view_svd/view_svd.h"

namespace mesorig::codecs::view_svd {
namespace {

using Eigen::MatrixXd;
using Eigen::MatrixXf;

using algebra::MatrixD;
using algebra::MatrixF;
using algebra::ViewF;

constexpr double kMaxGramBytes = 4e8;  // of each worker

// The weighted samples in blocks of texels, for several workers at once.
class ViewBlocks {
 public:
  ViewBlocks(const SampleSource& source, const SeparateWeights& weights, const EncodeOptions& options)
      : weights_(Product(weights)), matrix_(source, weights_, Weighting::kLinear),
        lights_(source.header().lights.size()), column_(source.present().size()),
        sizes_(BlocksOf(source, 4 * matrix_.cols(), options.block_bytes)) {
    for (size_t i = 0; i < matrix_.pairs().size(); ++i) column_[matrix_.pairs()[i]] = i;
    complete_ = matrix_.pairs().size() == column_.size();
  }
  int workers() const { return sizes_.workers; }

  // Calls function(worker, first texel, texels, samples).
  Status ForEach(const std::function<void(int, size_t, size_t, const float*)>& function) const {
    std::vector<std::unique_ptr<float[]>> scratch(static_cast<size_t>(workers()));
    return algebra::ForParts(
        workers(), matrix_.rows(), sizes_.texels, [&](int worker, int64_t first, int64_t count) -> Status {
          auto& own = scratch[static_cast<size_t>(worker)];
          if (own == nullptr) {
            own = std::make_unique_for_overwrite<float[]>(static_cast<size_t>(sizes_.texels * matrix_.cols()));
          }
          MESORIG_RETURN_IF_ERROR(matrix_.Rows(first, count, own.get()).status());
          function(worker, static_cast<size_t>(first), static_cast<size_t>(count), own.get());
          return OkStatus();
        });
  }

  // A column a view; rows (channel, texel) of `light`. In `storage` where some pairs are absent.
  ViewF Of(int light, const std::vector<int>& views, size_t count, const float* samples,
           MatrixF& storage) const {
    const auto rows = static_cast<int64_t>(3 * count), cols = static_cast<int64_t>(views.size());
    const auto first = [&](int view) {
      return samples + column_[static_cast<size_t>(view) * lights_ + static_cast<size_t>(light)] *
                           static_cast<size_t>(rows);
    };
    if (complete_) return {first(0), rows, cols, rows * static_cast<int64_t>(lights_)};
    storage = MatrixF(rows, cols);
    for (int64_t i = 0; i < cols; ++i) {
      std::copy_n(first(views[static_cast<size_t>(i)]), rows, storage.Column(i));
    }
    return storage;
  }

 private:
  SampleWeights weights_;
  AbrdfMatrix matrix_;
  size_t lights_;
  std::vector<size_t> column_;  // of each pair among those that are present
  bool complete_ = false;
  BlockSizes sizes_;
};

// The lights that the same views have seen, without what their rows say.
StatusOr<std::vector<LightGroup>> Patterns(const SampleSource& source) {
  std::map<std::vector<int>, std::vector<int>> lights_of;
  const btf::BtfHeader& h = source.header();
  for (int l = 0; l < h.light_count(); ++l) {
    std::vector<int> views;
    for (int v = 0; v < h.view_count(); ++v) {
      if (source.present()[static_cast<size_t>(v) * h.lights.size() + static_cast<size_t>(l)] != 0) {
        views.push_back(v);
      }
    }
    if (!views.empty()) lights_of[views].push_back(l);
  }
  double bytes = 0;
  std::vector<LightGroup> groups;
  for (const auto& [views, lights] : lights_of) {
    bytes += 8.0 * static_cast<double>(views.size()) * static_cast<double>(views.size());
    groups.push_back({views, lights, {}});
  }
  if (bytes > kMaxGramBytes) {
    return InvalidArgument("{} patterns of absent views need {:.1f} GB, at most {:.1f} are taken",
                           groups.size(), bytes * 1e-9, kMaxGramBytes * 1e-9);
  }
  return groups;
}

StatusOr<std::vector<LightGroup>> Groups(const SampleSource& source, const ViewBlocks& blocks) {
  MESORIG_ASSIGN_OR_RETURN(std::vector<LightGroup> groups, Patterns(source));
  std::vector<std::vector<MatrixD>> grams(static_cast<size_t>(blocks.workers()));
  for (std::vector<MatrixD>& of_worker : grams) {
    for (const LightGroup& group : groups) {
      const auto n = static_cast<int64_t>(group.views.size());
      of_worker.emplace_back(n, n);
    }
  }
  MESORIG_RETURN_IF_ERROR(blocks.ForEach([&](int worker, size_t, size_t count, const float* samples) {
    MatrixF storage;
    for (size_t g = 0; g < groups.size(); ++g) {
      for (const int l : groups[g].lights) {
        algebra::AddGram(blocks.Of(l, groups[g].views, count, samples, storage),
                         grams[static_cast<size_t>(worker)][g]);
      }
    }
  }));
  for (size_t g = 0; g < groups.size(); ++g) {
    const auto n = static_cast<Eigen::Index>(groups[g].views.size());
    groups[g].gram = MatrixXd::Zero(n, n);
    for (const std::vector<MatrixD>& of_worker : grams) {
      groups[g].gram += Eigen::Map<const MatrixXd>(of_worker[g].values.data(), n, n);
    }
  }
  return groups;
}

// G_l = M_l A_l, [light][texel][term][rgb], freed from the weights of its rows.
StatusOr<std::vector<float>> EigenTextures(const SampleSource& source, const SeparateWeights& weights,
                                           const ViewBlocks& blocks,
                                           const std::vector<LightGroup>& groups, const MatrixXd& e) {
  const size_t terms = static_cast<size_t>(e.cols()), texels = source.header().texel_count();
  const size_t size = source.header().lights.size() * texels * terms * 3;
  std::vector<float> values;
  values.reserve(size + 1);  // ViewSvdBtf adds one
  values.resize(size, 0.0f);
  std::vector<MatrixF> factors;
  for (const LightGroup& group : groups) {
    const MatrixXf a = OnPresent(e, group.views).cast<float>();
    factors.emplace_back(a.rows(), a.cols());
    std::copy_n(a.data(), a.size(), factors.back().values.data());
  }
  MESORIG_RETURN_IF_ERROR(blocks.ForEach([&](int, size_t first, size_t count, const float* samples) {
    MatrixF storage;
    for (size_t g = 0; g < groups.size(); ++g) {
      for (const int l : groups[g].lights) {
        const MatrixF part = algebra::Multiply(
            blocks.Of(l, groups[g].views, count, samples, storage), false, factors[g], false);
        float* const to = values.data() + (static_cast<size_t>(l) * texels + first) * terms * 3;
        for (size_t i = 0; i < count; ++i) {
          const float weight =
              weights.plain ? 1.0f : weights.light[static_cast<size_t>(l)] * weights.texel[first + i];
          for (size_t k = 0; k < terms; ++k) {
            const float* const from = part.Column(static_cast<int64_t>(k)) + i;
            for (size_t c = 0; c < 3; ++c) to[(i * terms + k) * 3 + c] = from[c * count] / weight;
          }
        }
      }
    }
  }));
  return values;
}

// Every term's eigen-textures are brought to a largest magnitude in (1/2, 1] by a power of two,
// which goes into E: half can neither overflow nor lose digits to the scaling.
void Balance(std::vector<float>& values, MatrixXd& e) {
  const auto terms = static_cast<size_t>(e.cols());
  std::vector<float> largest(terms, 0.0f), factor(terms, 1.0f);
  const auto for_values = [&](const auto& function) {
    for (size_t i = 0; i < values.size(); i += 3 * terms) {
      for (size_t k = 0; k < 3 * terms; ++k) function(k / 3, values[i + k]);
    }
  };
  for_values([&](size_t k, float& x) { largest[k] = std::max(largest[k], std::abs(x)); });
  for (size_t k = 0; k < terms; ++k) {
    const float scale = ScaleFor(largest[k]);
    factor[k] = 1 / scale;
    e.col(static_cast<Eigen::Index>(k)) *= static_cast<double>(scale);
  }
  for_values([&](size_t k, float& x) { x *= factor[k]; });
}

class ViewSvdEncoder final : public Encoder {
 public:
  std::string_view name() const override { return kName; }
  unsigned options() const override { return kWeighting | kQuantisation; }
  int max_terms(const btf::SampledBtf& btf) const override { return btf.header().view_count(); }

  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    MESORIG_ASSIGN_OR_RETURN(const SeparateWeights weights, SeparateWeightsFor(source, options));
    return Factorised(source, weights, options);
  }

 private:
  static StatusOr<std::unique_ptr<EncodedBtf>> Factorised(const SampleSource& source,
                                                          const SeparateWeights& separate,
                                                          const EncodeOptions& options) {
    const int views = source.header().view_count();
    const bool all = options.terms == kAllTerms;
    int terms = all ? views : options.terms;
    if (terms == 0) terms = std::min(kDefaultTerms, views);
    if (terms < 1 || terms > views) {
      return InvalidArgument("{} terms, permitted are 1 to {} (views) or all", terms, views);
    }
    const ViewBlocks blocks(source, separate, options);
    MESORIG_ASSIGN_OR_RETURN(const std::vector<LightGroup> groups, Groups(source, blocks));
    MatrixXd e = Factorise(groups, views, terms);
    MESORIG_ASSIGN_OR_RETURN(std::vector<float> textures,
                             EigenTextures(source, separate, blocks, groups, e));
    for (Eigen::Index v = 0; v < e.rows(); ++v) e.row(v) /= separate.view[static_cast<size_t>(v)];
    Balance(textures, e);
    const Quantisation quantisation =
        options.quantisation.value_or(all ? Quantisation::kFloat : Quantisation::kHalf);
    RoundTo(quantisation, textures);
    std::vector<float> weights;
    for (Eigen::Index v = 0; v < e.rows(); ++v) {
      for (Eigen::Index k = 0; k < e.cols(); ++k) weights.push_back(static_cast<float>(e(v, k)));
    }
    btf::BtfFileInfo info =
        InfoOf(source, kName, quantisation == Quantisation::kByte ? kVersion : 1);
    info.codec_options_json = nlohmann::json{{"terms", terms},
                                            {"weighting", NameOf(options.weighting)},
                                            {"solid_angle", options.solid_angle},
                                            {"variance", options.variance},
                                            {"quantisation", NameOf(quantisation)}}
                                 .dump();
    MESORIG_ASSIGN_OR_RETURN(auto encoded,
                             ViewSvdBtf::Create(std::move(info), terms, quantisation, std::move(weights),
                                                std::move(textures)));
    return std::unique_ptr<EncodedBtf>(std::move(encoded));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const ViewSvdEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::view_svd
