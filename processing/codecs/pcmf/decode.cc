// Decoder of codec pcmf; README.md.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs::pcmf {
namespace {

class PcmfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "pcmf"; }
  std::string_view paper() const override { return "Mueller et al. 2004, Sec. 3.2.4, Eq. 13; Kambhatla and Leen 1997"; }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return DecodeLinear(std::move(file), /*per_view=*/false, /*clustered=*/true);
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const PcmfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::pcmf
