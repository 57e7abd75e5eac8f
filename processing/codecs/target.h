#pragma once
// Encoders told what should come out instead of how many terms to take.

#include <cstdint>
#include <memory>

#include "processing/codecs/encoder.h"

namespace mesorig::codecs {

// What of a compressed BTF the pictures show, over the present samples inside the mask.
struct DecodedErrors {
  double rel_error = 0;      // ||decoded - btf|| / ||btf||, as btf::CompareBtf; 0 for two black ones
  double rmse = 0;           // sr^-1
  double psnr_db = 0;        // as btf::BtfErrors
  double p99_abs = 0;        // 99th percentile of |decoded - btf|, to 2 %
  double max_abs = 0;
  // Sum of what is below zero before any clamping over the sum of magnitudes of the original: what
  // clamping adds, or would add. The errors are those after clamping, where the file says so.
  double clamped_mass = 0;
};
// Decodes one image at a time. The header must be the BTF's.
DecodedErrors MeasureDecoded(const EncodedBtf& encoded, const btf::SampledBtf& btf);

// The size of the file that WriteEncodedBtf writes; writes it into the temporary folder and removes it.
StatusOr<uint64_t> FileBytes(const EncodedBtf& encoded);

struct Target {
  double error = 0;    // rel_error at most; 0: not asked for
  uint64_t bytes = 0;  // of the file at most; 0: not asked for
};
// The fewest terms that reach target.error, or the most that stay within target.bytes. Encodes about
// 2 log2(terms) times. options.terms is not looked at. InvalidArgument for both targets or none, a
// codec without terms, and a target that is out of reach, with what can be had.
StatusOr<std::unique_ptr<EncodedBtf>> EncodeToTarget(const Encoder& encoder,
                                                     const btf::SampledBtf& btf,
                                                     EncodeOptions options, const Target& target);

}  // namespace mesorig::codecs
