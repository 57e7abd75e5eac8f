// Decoder of codec fmf; README.md.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs::fmf {
namespace {

class FmfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "fmf"; }
  std::string_view paper() const override { return "Mueller et al. 2004, Sec. 3.2.2, Eq. 11; Koudelka et al. 2003"; }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return DecodeLinear(std::move(file), /*per_view=*/false, /*clustered=*/false);
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const FmfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::fmf
