#include "protocol/base/digest.h"

#include <fmt/core.h>
#include <openssl/evp.h>
#include <xxhash.h>

#include "protocol/base/check.h"

namespace mesorig {

std::string FrameDigest(std::string_view bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  return fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
}

uint64_t Checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

std::string Sha256(std::string_view bytes) {
  unsigned char out[32];
  unsigned int size = 0;
  MESORIG_CHECK(EVP_Digest(bytes.data(), bytes.size(), out, &size, EVP_sha256(), nullptr) == 1);
  std::string hex;
  for (unsigned int i = 0; i < size; ++i) hex += fmt::format("{:02x}", out[i]);
  return hex;
}

}  // namespace mesorig
