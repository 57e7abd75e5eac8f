#include <algorithm>

#include "processing/codecs/algebra/local_pca.h"
#include "processing/codecs/linear/linear_encoder.h"

namespace mesorig::codecs::pcmf {
namespace {

constexpr int kVersion = 1, kDefaultTerms = 8;
constexpr int kDefaultClusters = 32, kMaxClusters = 2048;
constexpr int kTexelsPerTerm = 4;  // by default no cluster is smaller on average
constexpr size_t kHeldBytes = size_t{512} << 20;  // of clusters that are read together
constexpr int64_t kCoordinates = 64, kCoordinatesPerTerm = 4;

// Mean and basis of cluster k, from the full rows of its texels.
Status FitBasis(const SampleSource& source, const SampleWeights& weights,
                const EncodeOptions& options, int k, std::vector<size_t> members,
                LinearFactors& factors) {
  AbrdfMatrix rows(source, weights, options.weighting);
  rows.Select(std::move(members));
  MESORIG_ASSIGN_OR_RETURN(const std::vector<float> mean, rows.MeanRow(options.block_bytes));
  rows.SetMean(mean);
  MESORIG_ASSIGN_OR_RETURN(
      const algebra::TruncatedSvd svd,
      algebra::DecomposeTruncated(rows, SvdOptionsFor(options, factors.shape.terms)));
  PutTerms(rows, svd, mean, 0, k, source.header(), factors);
  return OkStatus();
}

// All clusters. Of a source that is slow to read as many are held at a time as fit into kHeldBytes: it
// is read once for each such part of it. A cluster that is larger is read again and again.
Status FitBases(const SampleSource& source, const SampleWeights& weights,
                const EncodeOptions& options, LinearFactors& factors) {
  std::vector<std::vector<size_t>> members(static_cast<size_t>(factors.shape.clusters));
  for (size_t i = 0; i < factors.cluster.size(); ++i) members[factors.cluster[i]].push_back(i);
  const size_t most = std::max<size_t>(kHeldBytes / (12 * source.Pairs().size()), 1);
  for (size_t k = 0; k < members.size();) {
    size_t end = k, texels = 0;
    while (end < members.size() && texels + members[end].size() <= most) texels += members[end++].size();
    if (source.in_memory() || end == k) {
      MESORIG_RETURN_IF_ERROR(
          FitBasis(source, weights, options, static_cast<int>(k), std::move(members[k]), factors));
      ++k;
      continue;
    }
    std::vector<size_t> together;
    for (size_t i = k; i < end; ++i) together.insert(together.end(), members[i].begin(), members[i].end());
    std::sort(together.begin(), together.end());
    MESORIG_ASSIGN_OR_RETURN(const auto held, Hold(source, std::move(together), options.block_bytes));
    for (; k < end; ++k) {
      MESORIG_RETURN_IF_ERROR(
          FitBasis(*held, weights, options, static_cast<int>(k), std::move(members[k]), factors));
    }
  }
  return OkStatus();
}

class PcmfEncoder final : public Encoder {
 public:
  std::string_view name() const override { return "pcmf"; }
  unsigned options() const override {
    return kClusters | kWeighting | kLogWeighting | kQuantisation;
  }
  int max_terms(const btf::SampledBtf& btf) const override {
    return MostLinearTerms(MemorySource(btf));
  }

  // Müller et al. 2004, Eq. 13.
  StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                   const EncodeOptions& options) const override {
    MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
    LinearShape shape;
    shape.mean = true;
    MESORIG_ASSIGN_OR_RETURN(shape.terms,
                             TermsOf(options, kDefaultTerms, MostLinearTerms(source)));
    algebra::LocalPcaOptions local;
    local.terms = shape.terms;
    MESORIG_ASSIGN_OR_RETURN(local.clusters, ClustersOf(source.header(), options, shape.terms));
    MESORIG_ASSIGN_OR_RETURN(const SampleWeights weights, WeightsFor(source, options));
    const AbrdfMatrix matrix(source, weights, options.weighting);
    algebra::SvdOptions coordinates = SvdOptionsFor(
        options, std::max<int64_t>(kCoordinates, kCoordinatesPerTerm * shape.terms));
    coordinates.max_power_steps = 1;  // directions to cluster in, not factors
    MESORIG_ASSIGN_OR_RETURN(const algebra::LocalPcaResult clusters,
                             algebra::ClusterRows(matrix, weights.texel, coordinates, local));
    shape.clusters = clusters.clusters;
    LinearFactors factors = FactorsFor(source.header(), shape, weights, options);
    factors.cluster.assign(clusters.cluster.begin(), clusters.cluster.end());
    MESORIG_RETURN_IF_ERROR(FitBases(source, weights, options, factors));
    RoundFactors(source.header(), factors);
    btf::BtfFileInfo info = InfoOf(source, name(), kVersion);
    info.codec_options_json = OptionsJson(options, factors.quantisation, weights.floor,
                                          {{"terms", shape.terms}, {"clusters", shape.clusters}});
    return LinearBtf::Create(std::move(info), std::move(factors));
  }

 private:
  static StatusOr<int> ClustersOf(const btf::BtfHeader& header, const EncodeOptions& options,
                                  int terms) {
    const auto texels = static_cast<int>(header.texel_count());
    const int most = std::min(kMaxClusters, texels);
    if (options.clusters < 0 || options.clusters > most) {
      return InvalidArgument("{} clusters, permitted are 1 to {}", options.clusters, most);
    }
    if (options.clusters > 0) return options.clusters;
    return std::clamp(texels / (kTexelsPerTerm * terms), 1, std::min(kDefaultClusters, most));
  }
};

}  // namespace

const Encoder& TheEncoder() {
  static const PcmfEncoder encoder;
  return encoder;
}

}  // namespace mesorig::codecs::pcmf
