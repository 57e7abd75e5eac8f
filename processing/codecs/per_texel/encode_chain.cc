#include "processing/codecs/per_texel/encode_chain.h"

#include <algorithm>

#include "processing/codecs/algebra/matrix.h"
#include "processing/codecs/linear/pack_factors.h"
#include "processing/codecs/linear/sample_weights.h"

namespace mesorig::codecs::per_texel {

StatusOr<std::unique_ptr<EncodedBtf>> EncodeChain(const btf::SampledBtf& btf,
                                                  const EncodeOptions& options,
                                                  const ChainEncoding& encoding,
                                                  const Encoder& encoder, const FitBlock& fit) {
  const btf::BtfHeader& h = btf.header();
  const size_t texels = h.texel_count(), lights = h.lights.size();
  const size_t size = LayoutOf(encoding.stages, h).size;
  btf::BtfFileInfo info = InfoOf(btf, encoder.name(), encoding.version);
  std::vector<size_t> pairs;
  for (size_t pair = 0; pair < info.present.size(); ++pair) {
    if (info.present[pair] != 0) pairs.push_back(pair);
  }
  const size_t samples = 3 * pairs.size();
  const size_t at_once = std::clamp<size_t>(
      static_cast<size_t>(std::max<int64_t>(options.block_bytes, 1)) / (4 * samples), 1, texels);
  std::vector<float> values(texels * size, 0.0f), y(at_once * samples);
  for (size_t first = 0; first < texels; first += at_once) {
    const size_t count = std::min(at_once, texels - first);
    for (size_t p = 0; p < pairs.size(); ++p) {
      const float* const image =
          btf.Image(static_cast<int>(pairs[p] / lights), static_cast<int>(pairs[p] % lights)).data();
      for (size_t i = 0; i < count; ++i) {
        std::copy_n(image + 3 * (first + i), 3, y.data() + i * samples + 3 * p);
      }
    }
    const auto workers = static_cast<size_t>(algebra::Threads());
    const size_t part = (count + workers - 1) / workers;
    MESORIG_RETURN_IF_ERROR(algebra::ForParts(
        static_cast<int>(workers), static_cast<int64_t>(count), static_cast<int64_t>(part),
        [&](int worker, int64_t from, int64_t texels_of_part) {
          const auto i = static_cast<size_t>(from), n = static_cast<size_t>(texels_of_part);
          return fit({n, std::span(y).subspan(i * samples, n * samples),
                      std::span(values).subspan((first + i) * size, n * size), worker});
        }));
  }
  info.codec_options_json =
      OptionsJson(options, encoding.quantisation, encoding.floor, encoding.counts);
  return ChainBtf::Create(std::move(info),
                          Balanced(encoding.stages, h, encoding.quantisation,
                                   static_cast<float>(encoding.floor), std::move(values)));
}

std::vector<float> SquareWeights(const btf::SampledBtf& btf, const EncodeOptions& options,
                                 const ChainFitter& fitter, double log_floor) {
  std::vector<float> squares(3 * fitter.pairs().size(), 1.0f);
  if (!WeighsPairs(options)) return squares;
  const SampleWeights weights = WeightsFor(btf, options, log_floor);
  for (size_t i = 0; i < squares.size(); ++i) {
    const float w = weights.sample[3 * fitter.pairs()[i / 3] + i % 3];
    squares[i] = w * w;
  }
  return squares;
}

std::vector<ChainFitter> FitterForEachWorker(const ChainFitter& fitter) {
  return std::vector<ChainFitter>(static_cast<size_t>(algebra::Threads()), fitter);
}

Status DecomposeTexel(const btf::BtfHeader& header, const ChainFitter& fitter,
                      std::span<const float> y, std::span<float> values) {
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
    }
  }
  return OkStatus();
}

}  // namespace mesorig::codecs::per_texel
