#pragma once
// Philox4x32-10, a counter-based random generator: the same key and counter give the same numbers,
// in any order and on any number of threads.
// Salmon et al. 2011, "Parallel Random Numbers: As Easy as 1, 2, 3", Sec. 3.3.

#include <array>
#include <cstdint>

namespace mesorig::plant {

using PhiloxCounter = std::array<uint32_t, 4>;
using PhiloxKey = std::array<uint32_t, 2>;

PhiloxCounter Philox4x32(PhiloxCounter counter, PhiloxKey key);

// A stream of numbers for one (key, counter): words 1 to 3 of the counter are the caller's, word 0
// counts the blocks drawn. A value type; each thread has its own.
class PhiloxStream {
 public:
  PhiloxStream(PhiloxKey key, uint32_t c1, uint32_t c2, uint32_t c3)
      : key_(key), counter_{0, c1, c2, c3} {}
  uint32_t Word();
  double Uniform();   // [0, 1), 53 bits
  double Gaussian();  // mean 0, standard deviation 1 (Box-Muller)
  // Exact at every mean: inversion below 10, Hoermann's transformed rejection above. A mean that
  // is not positive gives 0.
  int64_t Poisson(double mean);

 private:
  PhiloxKey key_;
  PhiloxCounter counter_;
  PhiloxCounter block_{};
  int used_ = 4;
};

}  // namespace mesorig::plant
