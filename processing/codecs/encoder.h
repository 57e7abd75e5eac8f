#pragma once
// The encoding half of all compression methods.

#include <memory>
#include <string_view>
#include <vector>

#include "processing/codecs/codec.h"

namespace mesorig::codecs {

inline constexpr int kAllTerms = -1;

struct EncodeOptions {
  int terms = 0;              // 0: the codec's default; kAllTerms: as many as there can be
  double regularisation = -1;  // < 0: the codec's default
};

class Encoder {
 public:
  virtual ~Encoder() = default;
  virtual std::string_view name() const = 0;
  // InvalidArgument for options out of range, a BTF without any present pair, or one that holds
  // values that are not finite. Reentrant.
  virtual StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                                       const EncodeOptions& options) const = 0;
};

const std::vector<const Encoder*>& AllEncoders();
StatusOr<const Encoder*> FindEncoder(std::string_view name);

// The file information of a BTF that codec `name` encodes; value_scale is 1.
btf::BtfFileInfo InfoOf(const btf::SampledBtf& btf, std::string_view codec, int version);
// What every Encode begins with: something is present, everything present is finite.
Status CheckEncodable(const btf::SampledBtf& btf);

}  // namespace mesorig::codecs
