#pragma once
// The decoded form of codec view-svd (Wang et al. 2005, Sec. 5): the BTF as a matrix with rows
// (x, y, l, channel) and columns v, M ~ sum over terms k of G_k E_k^T. "Eigenmaps" G (4D) and "weight
// maps" E (2D) of the paper. The light is not factorised: it is interpolated between the measured
// ones. Renderers read the factors here.

#include <memory>
#include <span>
#include <vector>

#include "processing/btf/pair_weights.h"
#include "processing/codecs/codec.h"
#include "processing/codecs/linear/quantisation.h"

namespace mesorig::codecs::view_svd {

// Version 2 may hold bytes, and is written only where it does.
inline constexpr int kVersion = 2, kDefaultTerms = 4;
inline constexpr char kName[] = "view-svd";

class ViewSvdBtf final : public EncodedBtf {
 public:
  // eigen_textures: layer light * terms + term, W*H*3 values each, in [-1, 1] where they are stored
  // as bytes; weights: view * terms + term.
  // Sizes must match; InvalidArgument for a header that is wrong.
  static StatusOr<std::unique_ptr<ViewSvdBtf>> Create(btf::BtfFileInfo info, int terms,
                                                      Quantisation quantisation,
                                                      std::vector<float> weights,
                                                      std::vector<float> eigen_textures);

  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  std::vector<btf::Plane> Planes() const override;
  // Layers: eigen-textures; table: weights, then the presence where a pair is absent; columns: terms.
  std::optional<ShaderForm> ToShader() const override;

  int terms() const { return terms_; }
  // E[view * terms + term]
  std::span<const float> weights() const { return weights_; }
  // Layers of W*H*3 values, layer = light * terms + term: the order of the GLSL decoder's array
  // texture.
  std::span<const float> EigenTexture(int light, int term) const {
    const size_t size = 3 * info_.header.texel_count();
    return {eigen_textures_.data() +
                (static_cast<size_t>(light) * static_cast<size_t>(terms_) +
                 static_cast<size_t>(term)) * size,
            size};
  }
  const btf::PairInterpolator& interpolator() const { return interpolator_; }

 private:
  ViewSvdBtf(btf::BtfFileInfo info, int terms, Quantisation quantisation, std::vector<float> weights,
             std::vector<float> eigen_textures, btf::PairInterpolator interpolator)
      : info_(std::move(info)), terms_(terms), quantisation_(quantisation), weights_(std::move(weights)),
        eigen_textures_(std::move(eigen_textures)), interpolator_(std::move(interpolator)) {}

  btf::BtfFileInfo info_;
  int terms_;
  Quantisation quantisation_;  // of the eigen-textures
  std::vector<float> weights_, eigen_textures_;
  btf::PairInterpolator interpolator_;
};

}  // namespace mesorig::codecs::view_svd
