// A whole *.btf.exr, compressed or not. Whatever is refused names the file, what opens is finite.

#include "processing/btf/btf_file.h"

#include "tests/fuzz/decode_some.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const fuzz::ScratchFolder scratch;
  const auto path = scratch.path() / "a.btf.exr";
  fuzz::Overwrite(path, fuzz::View(data, size));
  const auto refused = [&](const Status& status) {
    MESORIG_CHECK(absl::IsInvalidArgument(status) &&
                  Message(status).find("a.btf.exr") != std::string_view::npos);
    return 0;
  };
  const auto info = btf::ReadBtfInfo(path);
  if (!info.ok()) return refused(info.status());
  MESORIG_CHECK(btf::CheckHeader(info->header).ok());
  if (info->codec == "raw") {
    const auto btf = btf::ReadSampledBtf(path);
    if (!btf.ok()) return refused(btf.status());
    for (const float x : btf->Image(0, 0)) MESORIG_CHECK(std::isfinite(x));
    return 0;
  }
  const auto encoded = codecs::ReadEncodedBtf(path);
  if (!encoded.ok()) return refused(encoded.status());
  fuzz::DecodeSome(**encoded);
  return 0;
}
