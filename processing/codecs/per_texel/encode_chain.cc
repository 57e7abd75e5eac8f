#include "processing/codecs/per_texel/encode_chain.h"

#include <algorithm>

#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/linear/sample_weights.h"
#include "processing/codecs/per_texel/cluster_tables.h"

namespace mesorig::codecs::per_texel {

namespace {

// [column][texel] to [texel][column], of `count` texels of `all`.
void Turn(const float* columns, size_t all, size_t count, size_t samples, float* y) {
  constexpr size_t kTile = 16;
  for (size_t i = 0; i < count; i += kTile) {
    const size_t n = std::min(kTile, count - i);
    for (size_t j = 0; j < samples; ++j) {
      for (size_t k = 0; k < n; ++k) y[(i + k) * samples + j] = columns[j * all + i + k];
    }
  }
}

}  // namespace

StatusOr<std::unique_ptr<EncodedBtf>> EncodeChain(const SampleSource& source,
                                                  const EncodeOptions& options,
                                                  const ChainEncoding& encoding,
                                                  const ChainWeights& weights,
                                                  const Encoder& encoder, const FitBlock& fit) {
  const btf::BtfHeader& h = source.header();
  const size_t texels = h.texel_count(), size = LayoutOf(encoding.stages, h).size;
  btf::BtfFileInfo info = InfoOf(source, encoder.name(), encoding.version);
  const std::vector<size_t> pairs = source.Pairs();
  const size_t samples = 3 * pairs.size();
  const auto at_once =
      static_cast<size_t>(BlocksOf(source, 4 * static_cast<int64_t>(samples), options.block_bytes).texels);
  std::vector<float> values(texels * size, 0.0f), columns(std::min(at_once, texels) * samples),
      y(columns.size());
  for (size_t first = 0; first < texels; first += at_once) {
    const size_t count = std::min(at_once, texels - first);
    MESORIG_RETURN_IF_ERROR(source.Columns(static_cast<int64_t>(first), static_cast<int64_t>(count),
                                           pairs, columns.data()));
    const auto workers = static_cast<size_t>(algebra::Threads());
    const size_t part = (count + workers - 1) / workers;
    MESORIG_RETURN_IF_ERROR(algebra::ForParts(
        static_cast<int>(workers), static_cast<int64_t>(count), static_cast<int64_t>(part),
        [&](int worker, int64_t from, int64_t texels_of_part) {
          const auto i = static_cast<size_t>(from), n = static_cast<size_t>(texels_of_part);
          Turn(columns.data() + i, count, n, samples, y.data() + i * samples);
          return fit({n, std::span(y).subspan(i * samples, n * samples),
                      std::span(values).subspan((first + i) * size, n * size), worker});
        }));
  }
  ChainFactors factors;
  const auto floor = static_cast<float>(encoding.floor);
  auto counts = encoding.counts;
  if (options.clusters == 0) {
    factors = Balanced(encoding.stages, h, encoding.quantisation, floor, std::move(values));
  } else {
    MESORIG_ASSIGN_OR_RETURN(
        factors,
        ClusterTables(ChainFitter(h, source.present(), encoding.stages), weights, options.clusters,
                      encoding.quantisation, floor, std::move(values)));
    counts.emplace_back("clusters", options.clusters);
  }
  info.codec_options_json = OptionsJson(options, encoding.quantisation, encoding.floor, counts);
  return ChainBtf::Create(std::move(info), std::move(factors));
}

StatusOr<ChainWeights> ChainWeightsFor(const SampleSource& source, const EncodeOptions& options,
                                       const ChainFitter& fitter, double log_floor) {
  const size_t views = source.header().views.size(), lights = source.header().lights.size();
  ChainWeights chain{std::vector<float>(3 * fitter.pairs().size(), 1.0f),
                     std::vector<float>(views, 1.0f), std::vector<float>(lights, 1.0f), {}};
  if (!WeighsPairs(options)) return chain;
  MESORIG_ASSIGN_OR_RETURN(SampleWeights weights, WeightsFor(source, options, log_floor));
  for (size_t i = 0; i < chain.squares.size(); ++i) {
    const float w = weights.sample[3 * fitter.pairs()[i / 3] + i % 3];
    chain.squares[i] = w * w;
  }
  SeparateWeights product = NearestProduct(std::move(weights), views, lights);
  chain.view = std::move(product.view), chain.light = std::move(product.light);
  chain.texel = std::move(product.texel);
  return chain;
}

std::vector<ChainFitter> FitterForEachWorker(const ChainFitter& fitter) {
  return std::vector<ChainFitter>(static_cast<size_t>(algebra::Threads()), fitter);
}

Status DecomposeTexel(const btf::BtfHeader& header, const ChainFitter& fitter,
                      const ChainWeights& weights, std::span<const float> y,
                      std::span<float> values) {
  const auto views = static_cast<int64_t>(header.views.size());
  const auto lights = static_cast<int64_t>(header.lights.size());
  const Layout::Tables& t = fitter.layout().stages[0];
  std::array<double, 3> mean{};
  for (size_t i = 0; i < y.size(); ++i) {
    mean[i % 3] += y[i] / static_cast<double>(fitter.pairs().size());
  }
  algebra::MatrixF turned(3 * lights, views);  // a column a view
  for (size_t i = 0; i < turned.values.size(); ++i) turned.values[i] = static_cast<float>(mean[i % 3]);
  for (size_t i = 0; i < y.size(); ++i) {
    turned.values[3 * fitter.pairs()[i / 3] + i % 3] = y[i];
  }
  for (int64_t v = 0; v < views; ++v) {
    float* const column = turned.Column(v);
    const float of_view = weights.view[static_cast<size_t>(v)];
    for (int64_t r = 0; r < 3 * lights; ++r) {
      column[r] *= of_view * weights.light[static_cast<size_t>(r / 3)];
    }
  }
  algebra::MatrixD gram(views, views);
  algebra::AddGram(turned, gram);
  std::vector<double> energies;
  MESORIG_RETURN_IF_ERROR(algebra::SymmetricEigen(gram, energies));
  for (int64_t k = 0; k < fitter.stages()[0].terms; ++k) {
    double sum = 0;  // of P: it is not negative
    for (int64_t v = 0; v < views; ++v) sum += gram(v, k);
    float* const p = values.data() + t.p_first + static_cast<size_t>(k * views);
    float* const q = values.data() + t.q_first + static_cast<size_t>(k * lights * 3);
    for (int64_t v = 0; v < views; ++v) p[v] = static_cast<float>(sum < 0 ? -gram(v, k) : gram(v, k));
    for (int64_t v = 0; v < views; ++v) {
      const float* const column = turned.Column(v);
      for (int64_t r = 0; r < 3 * lights; ++r) q[r] += p[v] * column[r];
      p[v] /= weights.view[static_cast<size_t>(v)];
    }
    for (int64_t r = 0; r < 3 * lights; ++r) q[r] /= weights.light[static_cast<size_t>(r / 3)];
  }
  return OkStatus();
}

}  // namespace mesorig::codecs::per_texel
