#pragma once
// Encoding as the tests of codecs do it.

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "processing/codecs/encoder.h"
#include "processing/codecs/target.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::codecs {

// So many texels, 11 views x 13 lights; texel 3 lies outside the mask.
inline btf::BtfHeader MaskedHeader(int width, int height) {
  btf::BtfHeader header = btf::SmallHeader(width, height, btf::RingDirections(2, 5, 60),
                                           btf::RingDirections(2, 6, 60));
  header.mask.assign(header.texel_count(), 1);
  header.mask[3] = 0;
  return header;
}

// So many terms, nothing rounded.
inline EncodeOptions Terms(int terms) {
  EncodeOptions options;
  options.terms = terms;
  options.quantisation = Quantisation::kFloat;
  return options;
}

// ||decoded - btf|| / ||btf||; 1e9, and a failure, when it cannot be encoded.
inline double ErrorOf(const Encoder& encoder, const btf::SampledBtf& btf,
                      const EncodeOptions& options) {
  const auto encoded = encoder.Encode(btf, options);
  EXPECT_TRUE(encoded.ok()) << encoded.status();
  return encoded.ok() ? MeasureDecoded(**encoded, btf).rel_error : 1e9;
}

// What a test over the registry is called by.
inline std::string CodecOfTest(const ::testing::TestParamInfo<const Encoder*>& parameter) {
  std::string name(parameter.param->name());
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

}  // namespace mesorig::codecs
