#pragma once
// How factors are stored. All lie in [-1, 1] (their scale is stored beside them).

#include <span>
#include <string_view>
#include <vector>

#include "processing/btf/btf_file.h"

namespace mesorig::codecs {

enum class Quantisation {
  kHalf,   // OpenEXR's half
  kFloat,
  kByte,   // q / 127, q a whole number in [-127, 127]
};
std::string_view NameOf(Quantisation quantisation);

// Values in [-1, 1] to what a file gives back.
void RoundTo(Quantisation quantisation, std::span<float> values);

// A plane of values that RoundTo has rounded. `values`: [channel][row][column].
btf::Plane QuantisedPlane(std::string name, int width, int height,
                          std::vector<std::string> channels, Quantisation quantisation,
                          std::vector<float> values);
// The values of a plane that was read, and how it was stored. InvalidArgument names the plane for
// values beyond [-1, 1].
StatusOr<std::vector<float>> Dequantised(btf::Plane plane, Quantisation& quantisation);

// The power of two that brings `largest` into (1/2, 1], 1 for 0; its exponent within +-100.
float ScaleFor(float largest);

}  // namespace mesorig::codecs
