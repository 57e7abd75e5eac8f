// Loops over lanes without branches or library calls, so that the compiler uses eight lanes.

#include "simulator/plant/read_noise.h"

#include <algorithm>
#include <bit>

#include "simulator/plant/philox.h"

namespace mesorig::plant {
namespace {

constexpr int kLanes = 16;  // blocks of four pixels at a time
// The first word of the counter: one that no pixel's own stream of philox.h reaches.
constexpr uint32_t kReadNoiseBlock = 0xFFFFFFFF;

// Philox4x32-10 (philox.h) of the counters {kReadNoiseBlock, group + lane, words 2, words 3}.
void PhiloxLanes(const std::array<uint32_t, 4>& words, uint32_t group, uint32_t (&c)[4][kLanes]) {
  for (uint32_t k = 0; k < kLanes; ++k) {
    c[0][k] = kReadNoiseBlock;
    c[1][k] = group + k;
    c[2][k] = words[2];
    c[3][k] = words[3];
  }
  uint32_t key0 = words[0], key1 = words[1];
  for (int round = 0; round < 10; ++round) {
    for (int k = 0; k < kLanes; ++k) {
      const uint64_t p0 = uint64_t{0xD2511F53} * c[0][k], p1 = uint64_t{0xCD9E8D57} * c[2][k];
      const uint32_t c1 = c[1][k], c3 = c[3][k];
      c[0][k] = static_cast<uint32_t>(p1 >> 32) ^ c1 ^ key0;
      c[1][k] = static_cast<uint32_t>(p1);
      c[2][k] = static_cast<uint32_t>(p0 >> 32) ^ c3 ^ key1;
      c[3][k] = static_cast<uint32_t>(p0);
    }
    key0 += 0x9E3779B9;
    key1 += 0xBB67AE85;
  }
}

// Natural logarithm of u in (0, 1): u = m 2^e, m in [sqrt(1/2), sqrt(2)), and log m as
// 2 artanh((m - 1) / (m + 1)), whose series ends below 1e-8 here.
inline float Log(float u) {
  const uint32_t bits = std::bit_cast<uint32_t>(u) - 0x3F3504F3u;  // of sqrt(1/2)
  const auto e = static_cast<float>(static_cast<int32_t>(bits) >> 23);
  const float m = std::bit_cast<float>((bits & 0x007FFFFFu) + 0x3F3504F3u);
  const float z = (m - 1) / (m + 1), z2 = z * z;
  const float series =
      2 * z * (1 + z2 * (1 / 3.0f + z2 * (1 / 5.0f + z2 * (1 / 7.0f + z2 * (1 / 9.0f)))));
  return e * 0.693147181f + series;
}

// Sine of 2 pi x for x in [-1/4, 1/4]: Taylor's series to the 11th power, below 6e-8.
inline float SinTurn(float x) {
  const float a = 6.28318531f * x, a2 = a * a;
  return a * (1 - a2 / 6 * (1 - a2 / 20 * (1 - a2 / 42 * (1 - a2 / 72 * (1 - a2 / 110)))));
}

// Two normal numbers from two random words.
inline void NormalPair(uint32_t a, uint32_t b, float& first, float& second) {
  // 24 bits and a half: u > 0, the radius is finite. Words as signed: a cheaper conversion.
  const float u = (static_cast<float>(static_cast<int32_t>(a >> 8)) + 0.5f) * 0x1p-24f;
  const float radius = __builtin_sqrtf(-2 * Log(u));
  // An angle in [-1/4, 1/4] of a turn and a random side: sine as is, cosine with the side's sign.
  const float turn = static_cast<float>(static_cast<int32_t>(b) >> 8) * 0x1p-25f;
  const float side = static_cast<float>(1 - 2 * static_cast<int32_t>(b & 1));
  const float sine = SinTurn(turn);
  const float cosine = SinTurn(0.25f - (turn < 0 ? -turn : turn));
  first = radius * sine;
  second = radius * side * cosine;
}

}  // namespace

void FillNormal(const std::array<uint32_t, 4>& words, uint32_t first, std::span<float> out) {
  size_t filled = 0;
  for (uint32_t group = first / 4; filled < out.size(); group += kLanes) {
    uint32_t c[4][kLanes];
    PhiloxLanes(words, group, c);
    float normal[4][kLanes];
    for (int k = 0; k < kLanes; ++k) {
      NormalPair(c[0][k], c[1][k], normal[0][k], normal[1][k]);
      NormalPair(c[2][k], c[3][k], normal[2][k], normal[3][k]);
    }
    const uint32_t skip = filled == 0 ? first % 4 : 0;
    const size_t count = std::min<size_t>(4 * kLanes - skip, out.size() - filled);
    for (size_t k = 0; k < count; ++k) {
      const size_t pixel = k + skip;
      out[filled + k] = normal[pixel % 4][pixel / 4];
    }
    filled += count;
  }
}

}  // namespace mesorig::plant
