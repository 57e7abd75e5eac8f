#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_weights.h"
#include "processing/codecs/view_svd/factorise.h"
#include "processing/codecs/view_svd/view_svd.h"

namespace mesorig::codecs::view_svd {
namespace {

using Eigen::MatrixXd;
using Eigen::MatrixXf;

constexpr Eigen::Index kBlock = 2048;  // rows at a time: fits the cache for a hundred views
constexpr double kMaxGramBytes = 4e9;

// The images of `views` under `light`, rows [first, first + rows), as columns, weighted.
MatrixXf Block(const btf::SampledBtf& btf, const SeparateWeights& weights, const std::vector<int>& views,
               int light, Eigen::Index first, Eigen::Index rows) {
  MatrixXf block(rows, static_cast<Eigen::Index>(views.size()));
  for (size_t i = 0; i < views.size(); ++i) {
    auto column = block.col(static_cast<Eigen::Index>(i));
    column = Eigen::Map<const Eigen::VectorXf>(btf.Image(views[i], light).data() + first, rows);
    if (weights.plain) continue;
    const float factor = weights.view[static_cast<size_t>(views[i])] *
                         weights.light[static_cast<size_t>(light)];
    for (Eigen::Index r = 0; r < rows; ++r) {
      column[r] *= factor * weights.texel[static_cast<size_t>(first + r) / 3];
    }
  }
  return block;
}

template <typename Function>
void ForBlocks(const btf::SampledBtf& btf, const Function& function) {
  const auto size = static_cast<Eigen::Index>(btf.image_size());
  for (Eigen::Index first = 0; first < size; first += kBlock) {
    function(first, std::min(kBlock, size - first));
  }
}

StatusOr<std::vector<LightGroup>> Groups(const btf::SampledBtf& btf, const SeparateWeights& weights) {
  std::map<std::vector<int>, std::vector<int>> lights_of;
  for (int l = 0; l < btf.header().light_count(); ++l) {
    std::vector<int> views;
    for (int v = 0; v < btf.header().view_count(); ++v) {
      if (btf.Present(v, l)) views.push_back(v);
    }
    if (!views.empty()) lights_of[views].push_back(l);
  }
  double bytes = 0;
  for (const auto& [views, lights] : lights_of) {
    bytes += 8.0 * static_cast<double>(views.size()) * static_cast<double>(views.size());
  }
  if (bytes > kMaxGramBytes) {
    return InvalidArgument("{} patterns of absent views need {:.1f} GB, at most {:.1f} are taken",
                           lights_of.size(), bytes * 1e-9, kMaxGramBytes * 1e-9);
  }
  std::vector<LightGroup> groups;
  for (const auto& [views, lights] : lights_of) {
    const auto n = static_cast<Eigen::Index>(views.size());
    MatrixXd gram = MatrixXd::Zero(n, n);
    for (const int l : lights) {
      ForBlocks(btf, [&](Eigen::Index first, Eigen::Index rows) {
        const MatrixXd block = Block(btf, weights, views, l, first, rows).cast<double>();
        gram.selfadjointView<Eigen::Lower>().rankUpdate(block.transpose());
      });
    }
    gram = MatrixXd(gram.selfadjointView<Eigen::Lower>());
    groups.push_back({views, lights, std::move(gram)});
  }
  return groups;
}

// G_l = M_l A_l, [light][texel][term][rgb], freed from the weights of its rows.
std::vector<float> EigenTextures(const btf::SampledBtf& btf, const SeparateWeights& weights,
                                 const std::vector<LightGroup>& groups, const MatrixXd& e) {
  const size_t terms = static_cast<size_t>(e.cols()), size = btf.image_size();
  std::vector<float> values;
  values.reserve(btf.header().lights.size() * terms * size + 1);  // ViewSvdBtf adds one
  values.resize(btf.header().lights.size() * terms * size, 0.0f);
  MatrixXf g;
  for (const LightGroup& group : groups) {
    const MatrixXf a = OnPresent(e, group.views).cast<float>();
    for (const int l : group.lights) {
      float* const of_light = values.data() + static_cast<size_t>(l) * terms * size;
      ForBlocks(btf, [&](Eigen::Index first, Eigen::Index rows) {
        g.noalias() = Block(btf, weights, group.views, l, first, rows) * a;
        for (Eigen::Index r = 0; r < rows; ++r) {
          const auto row = static_cast<size_t>(first + r);
          const float weight =
              weights.plain ? 1.0f : weights.light[static_cast<size_t>(l)] * weights.texel[row / 3];
          float* const to = of_light + row / 3 * terms * 3 + row % 3;
          for (size_t k = 0; k < terms; ++k) {
            to[3 * k] = g(r, static_cast<Eigen::Index>(k)) / weight;
          }
        }
      });
    }
  }
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

  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    const int views = btf.header().view_count();
    const bool all = options.terms == kAllTerms;
    int terms = all ? views : options.terms;
    if (terms == 0) terms = std::min(kDefaultTerms, views);
    if (terms < 1 || terms > views) {
      return InvalidArgument("{} terms, permitted are 1 to {} (views) or all", terms, views);
    }
    const SeparateWeights separate = SeparateWeightsFor(btf, options);
    MESORIG_ASSIGN_OR_RETURN(const std::vector<LightGroup> groups, Groups(btf, separate));
    MatrixXd e = Factorise(groups, views, terms);
    std::vector<float> textures = EigenTextures(btf, separate, groups, e);
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
        InfoOf(btf, kName, quantisation == Quantisation::kByte ? kVersion : 1);
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
