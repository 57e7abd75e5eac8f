#pragma once
// The decoded form of codec tucker (README.md): the core multiplied out, and fmf's form from there.
// Müller et al. 2004, Sec. 3.2.2; Vasilescu and Terzopoulos 2004.

#include <memory>
#include <span>
#include <vector>

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs::tucker {

inline constexpr int kVersion = 1;
inline constexpr char kName[] = "tucker";

// All but the weights of texels; [-1, 1].
struct Core {
  int terms = 0, view_terms = 0, light_terms = 0;
  std::vector<float> views;   // [view][view term]
  std::vector<float> lights;  // [light][rgb][light term]
  std::vector<float> values;  // [term][view term][light term]
  std::vector<float> scales;  // [term], powers of two, multiply the core
};

class TuckerBtf final : public EncodedBtf {
 public:
  // `g`: texels x stride of LinearShape, as in LinearFactors, in [-1, 1]. Sizes must match (our own
  // bug otherwise). InvalidArgument for a header that is wrong, and for more than 2 GiB of vectors.
  static StatusOr<std::unique_ptr<EncodedBtf>> Create(btf::BtfFileInfo info, Core core,
                                                      Quantisation quantisation, float log_floor,
                                                      std::vector<float> g);

  const btf::BtfFileInfo& info() const override { return expanded_->info(); }
  void DecodeImage(int view, int light, std::span<float> rgb) const override {
    expanded_->DecodeImage(view, light, rgb);
  }
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override {
    return expanded_->Evaluate(x, y, v, l);
  }
  void EvaluateBatch(std::span<const SampleQuery> queries,
                     std::span<std::array<float, 3>> out) const override {
    expanded_->EvaluateBatch(queries, out);
  }
  void DecodeSamples(std::span<const NodeQuery> queries,
                     std::span<std::array<float, 3>> out) const override {
    expanded_->DecodeSamples(queries, out);
  }
  std::vector<btf::Plane> Planes() const override;
  std::optional<ShaderForm> ToShader() const override { return expanded_->ToShader(); }

  const Core& core() const { return core_; }
  const LinearBtf& expanded() const { return *expanded_; }

 private:
  TuckerBtf(Core core, std::unique_ptr<LinearBtf> expanded)
      : core_(std::move(core)), expanded_(std::move(expanded)) {}

  Core core_;
  std::unique_ptr<LinearBtf> expanded_;
};

// How V, L and Z are stored where G is stored so.
inline Quantisation OfCore(Quantisation of_g) {
  return of_g == Quantisation::kFloat ? Quantisation::kFloat : Quantisation::kHalf;
}

}  // namespace mesorig::codecs::tucker
