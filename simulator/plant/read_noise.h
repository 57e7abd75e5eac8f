#pragma once
// Normal numbers for the pixels of a sensor, many at a time. Counter-based as Philox is: pixel i
// has the same number whichever pixels are asked for with it. Reentrant.

#include <array>
#include <cstdint>
#include <span>

namespace mesorig::plant {

// out[k] is pixel first + k's (row by row over the sensor), mean 0, standard deviation 1
// (Box-Muller in single precision: beyond 5.9 there is nothing). `words`: 128 bits that stand for
// the frame.
void FillNormal(const std::array<uint32_t, 4>& words, uint32_t first, std::span<float> out);

}  // namespace mesorig::plant
