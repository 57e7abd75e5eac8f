// Decoder of codec pvmf; README.md.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs::pvmf {
namespace {

class PvmfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "pvmf"; }
  std::string_view paper() const override { return "Mueller et al. 2004, Sec. 3.2.3, Eq. 12; Sattler et al. 2003"; }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return DecodeLinear(std::move(file), /*per_view=*/true, /*clustered=*/false);
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const PvmfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::pvmf
