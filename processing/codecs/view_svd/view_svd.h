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
  // eigen_textures: [light][texel][term][rgb] (a sample reads one stretch of memory a light), in
  // [-1, 1] where they are stored as bytes; weights: view * terms + term.
  // Sizes must match; InvalidArgument for a header that is wrong.
  static StatusOr<std::unique_ptr<ViewSvdBtf>> Create(btf::BtfFileInfo info, int terms,
                                                      Quantisation quantisation,
                                                      std::vector<float> weights,
                                                      std::vector<float> eigen_textures);

  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  void EvaluateBatch(std::span<const SampleQuery> queries,
                     std::span<std::array<float, 3>> out) const override;
  void DecodeSamples(std::span<const NodeQuery> queries,
                     std::span<std::array<float, 3>> out) const override;
  std::vector<btf::Plane> Planes() const override;
  // Layers: eigen-textures, light * terms + term; table: weights, then the presence where a pair is
  // absent; columns: terms.
  std::optional<ShaderForm> ToShader() const override;

  int terms() const { return terms_; }
  // E[view * terms + term]
  std::span<const float> weights() const { return weights_; }
  // [term][rgb] of a texel.
  const float* EigenTexel(int light, size_t texel) const {
    return eigen_textures_.data() +
           (static_cast<size_t>(light) * info_.header.texel_count() + texel) * 3 *
               static_cast<size_t>(terms_);
  }
  const btf::PairInterpolator& interpolator() const { return interpolator_; }

 private:
  ViewSvdBtf(btf::BtfFileInfo info, int terms, Quantisation quantisation, std::vector<float> weights,
             std::vector<float> eigen_textures, btf::PairInterpolator interpolator);
  // What a sample reads: three lights of three views; false where some of their pairs are absent.
  struct Taps;
  bool TapsOf(const SampleQuery& query, Taps& taps) const;
  std::array<float, 3> Sum(const Taps& taps) const;
  std::array<float, 3> SumOfPresent(const SampleQuery& query) const;
  size_t TexelOf(const SampleQuery& query) const {
    return static_cast<size_t>(query.y) * static_cast<size_t>(info_.header.width) +
           static_cast<size_t>(query.x);
  }

  btf::BtfFileInfo info_;
  int terms_;
  Quantisation quantisation_;  // of the eigen-textures
  std::vector<float> weights_;
  std::vector<float> eigen_textures_;  // and one value more: texels are read by fours of values
  btf::PairInterpolator interpolator_;
};

}  // namespace mesorig::codecs::view_svd
