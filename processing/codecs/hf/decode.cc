// Decoder of codec hf; README.md.

#include "processing/codecs/per_texel/chain_btf.h"

namespace mesorig::codecs::hf {
namespace {

using per_texel::Axis;

class HfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "hf"; }
  std::string_view paper() const override {
    return "Mueller et al. 2004, Sec. 3.2.1, Eq. 9; McCool et al. 2001";
  }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return per_texel::DecodeChain(std::move(file), {{Axis::kView, Axis::kLight, 1}, {Axis::kNone, Axis::kHalf, 1}});
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const HfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::hf
