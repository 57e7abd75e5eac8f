#pragma once
// Digests: XXH3-128 for frames (speed), SHA-256 for what is signed off (plans, rigs, audit).
// Both as lower-case hexadecimal. XXH3-64 for messages on a wire.

#include <cstdint>
#include <string>
#include <string_view>

namespace mesorig {

std::string FrameDigest(std::string_view bytes);
uint64_t Checksum(std::string_view bytes);
std::string Sha256(std::string_view bytes);

}  // namespace mesorig
