#pragma once
// The smallest codec there can be: every texel is a Lambert reflector, f = a cos(theta_l). One image
// a: a plain texture map, what a BTF is compared with (Mueller et al. 2004, Sec. 1). Copy this folder
// to begin a codec.

#include <memory>
#include <vector>

#include "processing/codecs/codec.h"

namespace mesorig::codecs::sample {

inline constexpr int kVersion = 1;
inline constexpr char kName[] = "mean";

class MeanBtf final : public EncodedBtf {
 public:
  // albedo: W*H*3.
  MeanBtf(btf::BtfFileInfo info, std::vector<float> albedo)
      : info_(std::move(info)), albedo_(std::move(albedo)) {}
  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  Status PredictImage(int view, Vec3 l, std::span<float> rgb) const override;
  std::vector<btf::Plane> Planes() const override;

 private:
  btf::BtfFileInfo info_;
  std::vector<float> albedo_;
};

// cos(theta_l) where the BTF has it inside, else 1; 0 below the horizon.
float Cosine(const btf::BtfHeader& header, Vec3 l);

}  // namespace mesorig::codecs::sample
