// Decoder of codec svd2; README.md.

#include "processing/codecs/per_texel/chain_btf.h"

namespace mesorig::codecs::svd2 {
namespace {

using per_texel::Axis;

class Svd2Decoder final : public Decoder {
 public:
  std::string_view name() const override { return "svd2"; }
  std::string_view paper() const override {
    return "Mueller et al. 2004, Sec. 3.2.1, Eq. 8; Kautz and McCool 1999";
  }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return per_texel::DecodeChain(std::move(file), {{Axis::kView, Axis::kLight, 1}});
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const Svd2Decoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::svd2
