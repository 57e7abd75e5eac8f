#include <algorithm>

#include "processing/codecs/linear/linear_encoder.h"
#include "processing/codecs/pcmf/local_pca.h"

namespace mesorig::codecs::pcmf {
namespace {

using algebra::MatrixF;

constexpr int kVersion = 1, kDefaultTerms = 8, kMaxTerms = 4096;
constexpr int kDefaultClusters = 32, kMaxClusters = 2048;
constexpr int kTexelsPerTerm = 4;  // by default no cluster is smaller on average
constexpr int64_t kCoordinates = 64, kCoordinatesPerTerm = 4;

// Coordinates of the texels in the leading singular vectors, as clustering sees them.
StatusOr<LocalPcaResult> Clusters(const AbrdfMatrix& matrix, const algebra::SvdOptions& base,
                                  const LocalPcaOptions& options) {
  algebra::SvdOptions svd_options = base;
  svd_options.rank = std::max<int64_t>(kCoordinates, kCoordinatesPerTerm * options.terms);
  svd_options.max_power_steps = 1;  // directions to cluster in, not factors
  MESORIG_ASSIGN_OR_RETURN(const algebra::TruncatedSvd svd,
                           algebra::DecomposeTruncated(matrix, svd_options));
  MatrixF points = svd.u;
  std::vector<float> weights(static_cast<size_t>(points.rows));
  for (int64_t i = 0; i < points.rows; ++i) {
    const float weight = matrix.TexelWeight(i);
    weights[static_cast<size_t>(i)] = weight * weight;
    for (int64_t j = 0; j < points.cols; ++j) {
      points(i, j) *= static_cast<float>(svd.sigma[static_cast<size_t>(j)] / weight);
    }
  }
  return ClusterByLocalPca(points, weights, options);
}

class PcmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "pcmf"; }
  unsigned options() const override {
    return kClusters | kWeighting | kLogWeighting | kQuantisation;
  }
  int max_terms(const btf::SampledBtf& btf) const override {
    return static_cast<int>(std::min<size_t>(
        {kMaxTerms, btf.header().texel_count(), 3 * btf.present_count()}));
  }

  // Müller et al. 2004, Eq. 13.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(btf, options, *this));
    LinearShape shape;
    shape.mean = true;
    MESORIG_ASSIGN_OR_RETURN(shape.terms, TermsOf(options, kDefaultTerms, max_terms(btf)));
    LocalPcaOptions local;
    local.terms = shape.terms;
    MESORIG_ASSIGN_OR_RETURN(local.clusters, ClustersOf(btf, options, shape.terms));
    const SampleWeights weights = WeightsFor(btf, options);
    const AbrdfMatrix matrix(btf, weights, options.weighting);
    const algebra::SvdOptions svd_options = SvdOptionsFor(options, shape.terms);
    MESORIG_ASSIGN_OR_RETURN(const LocalPcaResult clusters, Clusters(matrix, svd_options, local));
    shape.clusters = clusters.clusters;
    LinearFactors factors = FactorsFor(btf.header(), shape, weights, options);
    factors.cluster.assign(clusters.cluster.begin(), clusters.cluster.end());
    for (int k = 0; k < shape.clusters; ++k) {
      AbrdfMatrix rows(btf, weights, options.weighting);
      rows.Select(Members(clusters.cluster, k));
      MESORIG_ASSIGN_OR_RETURN(const std::vector<float> mean, rows.MeanRow(options.block_bytes));
      rows.SetMean(mean);
      MESORIG_ASSIGN_OR_RETURN(const algebra::TruncatedSvd svd,
                               algebra::DecomposeTruncated(rows, svd_options));
      PutTerms(rows, svd, mean, 0, k, btf.header(), factors);
    }
    RoundFactors(btf.header(), factors);
    btf::BtfFileInfo info = InfoOf(btf, name(), kVersion);
    info.codec_options_json = OptionsJson(options, factors.quantisation, weights.floor,
                                          {{"terms", shape.terms}, {"clusters", shape.clusters}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }

 private:
  static StatusOr<int> ClustersOf(const btf::SampledBtf& btf, const EncodeOptions& options,
                                  int terms) {
    const auto texels = static_cast<int>(btf.header().texel_count());
    const int most = std::min(kMaxClusters, texels);
    if (options.clusters < 0 || options.clusters > most) {
      return InvalidArgument("{} clusters, permitted are 1 to {}", options.clusters, most);
    }
    if (options.clusters > 0) return options.clusters;
    return std::clamp(texels / (kTexelsPerTerm * terms), 1, std::min(kDefaultClusters, most));
  }

  static std::vector<size_t> Members(const std::vector<int>& cluster, int k) {
    std::vector<size_t> members;
    for (size_t i = 0; i < cluster.size(); ++i) {
      if (cluster[i] == k) members.push_back(i);
    }
    return members;
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const PcmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::pcmf
