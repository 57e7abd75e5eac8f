#pragma once
// The decoded form of svd2, hf and cmf (README.md).

#include <memory>
#include <span>
#include <vector>

#include "processing/btf/pair_weights.h"
#include "processing/codecs/codec.h"
#include "processing/codecs/linear/quantisation.h"
#include "processing/codecs/per_texel/chain.h"

namespace mesorig::codecs::per_texel {

struct ChainFactors {
  std::vector<Stage> stages;
  Quantisation quantisation = Quantisation::kHalf;
  float floor = 0;            // values are the product less this
  std::vector<float> values;  // [row][Layout], in [-1, 1]
  std::vector<float> scales;  // [texel][stage], within 2^+-60
  // [texel][stage]: the row of values that the texel's stage reads. Empty: a row is a texel.
  std::vector<uint16_t> clusters;

  size_t RowOf(size_t texel, size_t stage) const {
    return clusters.empty() ? texel : clusters[texel * stages.size() + stage];
  }
};
inline constexpr size_t kMaxClusters = 2048;  // whole numbers that half holds

// Rows for texels, of factors that are clustered too: [texel][Layout], scales taken in where
// `unscale`.
std::vector<float> TablesOfTexels(const ChainFactors& factors, const Layout& layout, bool unscale);

class ChainBtf final : public EncodedBtf {
 public:
  // Sizes must match (our own bug otherwise); InvalidArgument for a header that is wrong.
  static StatusOr<std::unique_ptr<EncodedBtf>> Create(btf::BtfFileInfo info, ChainFactors factors);

  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  void DecodeSamples(std::span<const NodeQuery> queries,
                     std::span<std::array<float, 3>> out) const override;
  std::vector<btf::Plane> Planes() const override;
  // Fits the mip levels: about a third of what encoding with as many sweeps takes. Clusters become
  // texels; none where that takes more than 2 GiB.
  std::optional<ShaderForm> ToShader() const override;

  const ChainFactors& factors() const { return factors_; }
  const Layout& layout() const { return layout_; }

 private:
  ChainBtf(btf::BtfFileInfo info, ChainFactors factors, btf::PairInterpolator interpolator);
  std::array<float, 3> Value(const PairTaps& taps, size_t texel) const;
  std::array<float, 3> Value(int view, int light, size_t texel) const;

  btf::BtfFileInfo info_;
  ChainFactors factors_;
  Layout layout_;
  btf::PairInterpolator interpolator_;
  std::vector<PairTaps> taps_;  // of every pair; empty where there are too many pairs
};

// What the Decode of a codec of this family does. `stages`: the codec's axes; the numbers of terms are
// taken from the file.
StatusOr<std::unique_ptr<EncodedBtf>> DecodeChain(btf::CodedBtf file, std::vector<Stage> stages);

// Last of encoding: tables of all texels as they were fitted (no scales, [texel][Layout]) are balanced
// into [-1, 1] and rounded to what the file stores.
ChainFactors Balanced(std::vector<Stage> stages, const btf::BtfHeader& header,
                      Quantisation quantisation, float floor, std::vector<float> values);

// The same of factors that are clustered: rows into [-1, 1], scales of texels by what that took.
void BalanceRows(const Layout& layout, ChainFactors& factors);

// Internal: the levels above the first, one after the other as MipFactors of linear_mips.h has them;
// each texel's tables are fitted to the mean of what the texels below decode to.
struct ChainMips {
  std::vector<float> values;  // [texel][Layout], scales taken out as in ChainFactors
  std::vector<float> scales;
};
ChainMips FitMips(const btf::BtfFileInfo& info, const ChainFactors& factors);

}  // namespace mesorig::codecs::per_texel
