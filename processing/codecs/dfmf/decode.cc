// Decoder of codec dfmf; README.md.

#include "processing/codecs/linear/linear_btf.h"

namespace mesorig::codecs::dfmf {
namespace {

class DfmfDecoder final : public Decoder {
 public:
  std::string_view name() const override { return "dfmf"; }
  std::string_view paper() const override { return "Mueller 2009, decorrelated full-matrix factorisation; Mueller et al. 2004, Eq. 11"; }
  int version() const override { return 1; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    return DecodeLinear(std::move(file), /*per_view=*/false, /*clustered=*/false,
                        /*decorrelated=*/true);
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const DfmfDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::dfmf
