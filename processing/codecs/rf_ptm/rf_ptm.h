#pragma once
// The decoded form of codec rf-ptm: for every measured view and texel, and each of R, G, B, a
// biquadratic polynomial of the light direction projected onto the plane (Malzbender et al. 2001,
// Eq. 5, as the reflectance field of Meseth et al.; Mueller et al. 2004, Sec. 3.1.3, Eq. 5):
//   f(l) = a0 lx^2 + a1 ly^2 + a2 lx ly + a3 lx + a4 ly + a5, never below zero.

#include <memory>
#include <vector>

#include "processing/btf/pair_weights.h"
#include "processing/codecs/codec.h"

namespace mesorig::codecs::rf_ptm {

inline constexpr int kVersion = 1, kCoefficients = 6;
inline constexpr char kName[] = "rf-ptm";

// The basis above at unit vector l.
std::array<double, kCoefficients> Basis(Vec3 l);

class RfPtmBtf final : public EncodedBtf {
 public:
  // coefficients: [view][coefficient][texel][rgb]; times info.value_scale they give the value.
  static StatusOr<std::unique_ptr<RfPtmBtf>> Create(btf::BtfFileInfo info,
                                                    std::vector<float> coefficients);
  const btf::BtfFileInfo& info() const override { return info_; }
  void DecodeImage(int view, int light, std::span<float> rgb) const override;
  // Between views the values are interpolated, as in Eq. 5. The light is not interpolated: within
  // the measured cone the polynomial is evaluated at l, beyond it at the nearest direction of the
  // cone, times HorizonScale (a polynomial is worth nothing far from its data).
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const override;
  // The polynomial at l, wherever it lies above the horizon.
  Status PredictImage(int view, Vec3 l, std::span<float> rgb) const override;
  std::vector<btf::Plane> Planes() const override;

 private:
  RfPtmBtf(btf::BtfFileInfo info, std::vector<float> coefficients,
           btf::PairInterpolator interpolator)
      : info_(std::move(info)), coefficients_(std::move(coefficients)),
        interpolator_(std::move(interpolator)) {}
  void Polynomial(int view, Vec3 l, std::span<float> rgb) const;

  btf::BtfFileInfo info_;
  std::vector<float> coefficients_;
  btf::PairInterpolator interpolator_;
};

}  // namespace mesorig::codecs::rf_ptm
