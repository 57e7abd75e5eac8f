#pragma once
// The non-negativity policy of a compressed BTF. Sums of terms go below zero where the material is
// dark; a file says (btf::BtfFileInfo::clamp_negative) whether its decoder keeps that, so that errors
// stay linear, or shows zero. Clamped is what comes out, last of all: an image's value, a value
// interpolated between directions, a filtered look-up of a shader.

#include <memory>

#include "processing/codecs/codec.h"

namespace mesorig::codecs {

// `encoded`, which decodes to nothing below zero and whose file says so. Reentrant as `encoded` is.
std::unique_ptr<EncodedBtf> Clamped(std::unique_ptr<EncodedBtf> encoded);

}  // namespace mesorig::codecs
