#include <cmath>

#include "processing/codecs/encoder.h"

namespace mesorig::codecs {

btf::BtfFileInfo InfoOf(const btf::SampledBtf& btf, std::string_view codec, int version) {
  btf::BtfFileInfo info;
  info.header = btf.header();
  info.codec = codec;
  info.codec_version = version;
  info.codec_options_json = "{}";
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      info.present.push_back(btf.Present(v, l) ? 1 : 0);
    }
  }
  return info;
}

Status CheckEncodable(const btf::SampledBtf& btf) {
  if (btf.present_count() == 0) return InvalidArgument("no (view, light) pair is present");
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      for (const float value : btf.Image(v, l)) {
        if (!std::isfinite(value)) {
          return InvalidArgument("view {}, light {} holds a value that is not finite", v, l);
        }
      }
    }
  }
  return OkStatus();
}

}  // namespace mesorig::codecs
