#pragma once
// One codec at one setting, measured: error, time, size and memory together, on the same data.

#include <string>
#include <vector>

#include "processing/codecs/target.h"

namespace mesorig::codecs {

// The most memory that this process has held since the object was made, beside what it held then. One
// at a time: the peak is the process's.
class PeakMemory {
 public:
  PeakMemory();
  int64_t Bytes() const;  // -1 where the kernel does not tell

 private:
  bool restarted_;
  int64_t before_;
};

struct BenchPoint {
  const Encoder* encoder = nullptr;
  EncodeOptions options;
  std::string series;  // what one line of a plot joins: the codec, and how it stores
  std::string label;   // the point on that line: its terms
};
// The settings that a sweep of this codec tries: terms by powers of two up to `most_terms`, stored as
// half and, where the codec can, as bytes; one point for a codec without terms.
std::vector<BenchPoint> Sweep(const Encoder& encoder, const btf::SampledBtf& btf, int most_terms);

struct BenchResult {
  DecodedErrors errors;
  uint64_t bytes = 0;
  double encode_s = 0;
  double image_samples_per_s = 0;   // RGB values of whole images, one thread
  double access_samples_per_s = 0;  // RGB values at random texels and directions, one thread
  int64_t peak_bytes = -1;          // most memory held while encoding, beside the BTF; -1: unknown
  std::string options_json;         // as the file says
  std::unique_ptr<EncodedBtf> encoded;
};
// Encodes, writes and reads nothing but the point's own file. One point at a time (PeakMemory).
StatusOr<BenchResult> Measure(const BenchPoint& point, const btf::SampledBtf& btf);

}  // namespace mesorig::codecs
