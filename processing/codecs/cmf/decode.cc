// Decoder of codec cmf; README.md.

#include "processing/codecs/per_texel/chain_btf.h"

namespace mesorig::codecs::cmf {
namespace {

using per_texel::Axis;

class CmfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "cmf"; }
  std::string_view paper() const override {
    return "Mueller et al. 2004, Sec. 3.2.1, Eq. 10; Suykens et al. 2003";
  }
  int version() const override { return 2; }  // 2: clustered tables
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return per_texel::DecodeChain(std::move(file), {{Axis::kView, Axis::kLight, 1}, {Axis::kHalf, Axis::kDifference, 1}});
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const CmfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::cmf
