#include "processing/codecs/linear/quantisation.h"

#include <algorithm>
#include <cmath>

namespace mesorig::codecs {
namespace {

constexpr float kSteps = 127;

}  // namespace

std::string_view NameOf(Quantisation quantisation) {
  switch (quantisation) {
    case Quantisation::kHalf:
      return "half";
    case Quantisation::kFloat:
      return "float";
    case Quantisation::kByte:
      return "8bit";
  }
  return "half";
}

void RoundTo(Quantisation quantisation, std::span<float> values) {
  if (quantisation == Quantisation::kHalf) btf::RoundToHalf(values);
  if (quantisation != Quantisation::kByte) return;
  for (float& x : values) x = std::round(std::clamp(x, -1.0f, 1.0f) * kSteps) / kSteps;
}

btf::Plane QuantisedPlane(std::string name, int width, int height,
                          std::vector<std::string> channels, Quantisation quantisation,
                          std::vector<float> values) {
  btf::Plane plane{std::move(name), width, height, std::move(channels),
                   quantisation == Quantisation::kHalf, std::move(values)};
  if (quantisation == Quantisation::kByte) {
    plane.bytes = true;
    for (float& x : plane.values) x = std::round(x * kSteps);
  }
  return plane;
}

StatusOr<std::vector<float>> Dequantised(btf::Plane plane, Quantisation& quantisation) {
  quantisation = plane.bytes  ? Quantisation::kByte
                 : plane.half ? Quantisation::kHalf
                              : Quantisation::kFloat;
  if (plane.bytes) {
    for (float& x : plane.values) x /= kSteps;
  }
  for (const float x : plane.values) {
    if (!(std::abs(x) <= 1)) {
      return InvalidArgument("part {} holds {}, permitted are -1 to 1", plane.name, x);
    }
  }
  return std::move(plane.values);
}

float ScaleFor(float largest) {
  if (!(largest > 0)) return 1;
  int exponent = 0;
  std::frexp(largest, &exponent);
  return std::ldexp(1.0f, std::clamp(exponent, -100, 100));
}

}  // namespace mesorig::codecs
