#pragma once
// The decoded form of fmf, pvmf and pcmf (README.md): weights per texel times vectors over directions.
// Müller et al. 2004, Eqs. 11-13.

#include <memory>
#include <span>
#include <vector>

#include "processing/btf/pair_weights.h"
#include "processing/codecs/codec.h"
#include "processing/codecs/linear/quantisation.h"

namespace mesorig::codecs {

// Which basis a value belongs to.
struct LinearShape {
  int terms = 0;
  bool per_view = false;  // a basis a view, and weights a view
  int clusters = 1;       // bases that texels choose from; 1 for per_view
  bool mean = false;      // each basis has a mean, of weight 1, behind its terms

  // Factors are kept in strides of four values, the last ones zero.
  int stride() const { return (terms + (mean ? 1 : 0) + 3) / 4 * 4; }
  int families(const btf::BtfHeader& h) const { return per_view ? h.view_count() : 1; }
  int bases(const btf::BtfHeader& h) const { return per_view ? h.view_count() : clusters; }
  // Pairs that one basis spans.
  size_t pairs(const btf::BtfHeader& h) const {
    return per_view ? h.lights.size() : h.views.size() * h.lights.size();
  }
};

struct LinearFactors {
  LinearShape shape;
  Quantisation quantisation = Quantisation::kHalf;
  float log_floor = 0;            // above 0: values are exp(y) - floor
  // The three channels are log(1 + Y / floor), U / (Y + floor), V / (Y + floor): FromDecorrelated.
  bool decorrelated = false;
  std::vector<float> g;           // [family][texel][stride]; the mean's weight is 1
  std::vector<float> h;           // [basis][pair][rgb][stride]
  std::vector<float> scales;      // [basis][stride]: h / scale and g lie in [-1, 1]
  std::vector<uint16_t> cluster;  // [texel]; empty where shape.clusters is 1
};

// RGB to (log(1 + Y / floor), U / (Y + floor), V / (Y + floor)) and back; Y below zero counts as zero.
// ITU-R BT.601 luma and unscaled colour differences U = B - Y, V = R - Y.
std::array<float, 3> ToDecorrelated(const float* rgb, float floor);
std::array<float, 3> FromDecorrelated(const std::array<float, 3>& luv, float floor);

class LinearBtf final : public EncodedBtf {
 public:
  // Sizes must match the shape (our own bug otherwise); InvalidArgument for a header that is wrong.
  // `glsl`: the decoder for shaders.
  static StatusOr<std::unique_ptr<EncodedBtf>> Create(btf::BtfFileInfo info, LinearFactors factors);

  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  void DecodeSamples(std::span<const NodeQuery> queries,
                     std::span<std::array<float, 3>> out) const override;
  std::vector<btf::Plane> Planes() const override;
  // Layers: terms by threes (linear_shader.cc).
  std::optional<ShaderForm> ToShader() const override;

  const LinearFactors& factors() const { return factors_; }

 private:
  LinearBtf(btf::BtfFileInfo info, LinearFactors factors, btf::PairInterpolator interpolator)
      : info_(std::move(info)), factors_(std::move(factors)),
        interpolator_(std::move(interpolator)) {}
  const float* Weights(int view, size_t texel) const {
    const size_t family = factors_.shape.per_view ? static_cast<size_t>(view) : 0;
    return factors_.g.data() + (family * info_.header.texel_count() + texel) *
                                   static_cast<size_t>(factors_.shape.stride());
  }
  // Of the three channels, one after the other.
  const float* Vectors(int view, int light, size_t texel) const {
    const size_t lights = info_.header.lights.size();
    const size_t pair = factors_.shape.per_view
                            ? static_cast<size_t>(light)
                            : static_cast<size_t>(view) * lights + static_cast<size_t>(light);
    const size_t basis = factors_.shape.per_view    ? static_cast<size_t>(view)
                         : factors_.cluster.empty() ? 0
                                                    : factors_.cluster[texel];
    return factors_.h.data() + (basis * factors_.shape.pairs(info_.header) + pair) * 3 *
                                   static_cast<size_t>(factors_.shape.stride());
  }
  std::array<float, 3> Value(int view, int light, size_t texel) const;

  btf::BtfFileInfo info_;
  LinearFactors factors_;
  btf::PairInterpolator interpolator_;
};

// What the Decode of a codec of this family does. The codec's shape: per_view, whether there may be
// clusters, and whether its channels are decorrelated.
StatusOr<std::unique_ptr<EncodedBtf>> DecodeLinear(btf::CodedBtf file, bool per_view, bool clustered,
                                                   bool decorrelated = false);

}  // namespace mesorig::codecs
