#pragma once
// Internal to the encoder of tucker: the two modes of directions of a tensor whose texel mode has
// been cut already (De Lathauwer, De Moor and Vandewalle 2000, HOSVD and HOOI).

#include <cstdint>
#include <vector>

#include "processing/codecs/algebra/matrix.h"

namespace mesorig::codecs::tucker {

// T(a, v, r): texel terms x views x rows (a channel of a light each).
struct Tensor {
  int64_t terms = 0, views = 0, rows = 0;
  std::vector<float> values;     // [a][v][r]; anything where absent
  std::vector<uint8_t> present;  // [v][r]; empty: everything is

  float* Slice(int64_t a) { return values.data() + a * views * rows; }
  const float* Slice(int64_t a) const { return values.data() + a * views * rows; }
  bool Present(int64_t v, int64_t r) const {
    return present.empty() || present[static_cast<size_t>(v * rows + r)] != 0;
  }
};

struct Modes {
  algebra::MatrixF views;   // views x view terms, orthonormal columns
  algebra::MatrixF rows;    // rows x row terms, orthonormal columns
  std::vector<float> core;  // [a][view term][row term]
  int rounds = 0;
};

// As many view and row terms as leave at most `budget` (energy, the tensor's unit squared) each
// behind; all of them for a budget of 0. Absent entries are filled in by what the factors say of
// them, until the error over what is present stands still. Internal where LAPACK fails.
StatusOr<Modes> DecomposeModes(Tensor tensor, double budget);

}  // namespace mesorig::codecs::tucker
