#include "processing/codecs/codec.h"

#include <fmt/ranges.h>

#include "processing/codecs/clamped.h"

#define MESORIG_ENTRY(id, public_name) \
  namespace mesorig::codecs::id {      \
  const Decoder& TheDecoder();         \
  }
#include "processing/codecs/registry_table.inc"
#undef MESORIG_ENTRY

namespace mesorig::codecs {

const std::vector<const Decoder*>& AllDecoders() {
  static const std::vector<const Decoder*> all = {
#define MESORIG_ENTRY(id, public_name) &id::TheDecoder(),
#include "processing/codecs/registry_table.inc"
#undef MESORIG_ENTRY
  };
  return all;
}

StatusOr<const Decoder*> FindDecoder(std::string_view name) {
  std::vector<std::string_view> names;
  for (const Decoder* decoder : AllDecoders()) {
    if (decoder->name() == name) return decoder;
    names.push_back(decoder->name());
  }
  return InvalidArgument("there is no codec `{}`; there are {}", name, fmt::join(names, ", "));
}

Status WriteEncodedBtf(const EncodedBtf& encoded, const std::filesystem::path& path) {
  const btf::BtfFileInfo& info = encoded.info();
  std::vector<float> preview(3 * info.header.texel_count());
  const auto [view, light] = btf::PreviewPair(info.header, info.present);
  encoded.DecodeImage(view, light, preview);
  return btf::WriteCodedBtf(info, encoded.Planes(), preview, path);
}

StatusOr<std::unique_ptr<EncodedBtf>> ReadEncodedBtf(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(btf::CodedBtf file, btf::ReadCodedBtf(path));
  const std::string name = file.info.codec;
  if (name == "raw") {
    return InvalidArgument("{}: is not compressed, a compressed BTF is expected", path.string());
  }
  const auto decoder = FindDecoder(name);
  if (!decoder.ok()) return Annotate(decoder.status(), path.string());
  if (file.info.codec_version < 1 || file.info.codec_version > (*decoder)->version()) {
    return InvalidArgument("{}: version {} of codec {}, this program reads up to {}",
                           path.string(), file.info.codec_version, name, (*decoder)->version());
  }
  auto encoded = (*decoder)->Decode(std::move(file));
  if (!encoded.ok()) return Annotate(encoded.status(), path.string());
  if ((*encoded)->info().clamp_negative) return Clamped(*std::move(encoded));
  return encoded;
}

btf::SampledBtf DecodeAll(const EncodedBtf& encoded) {
  const btf::BtfFileInfo& info = encoded.info();
  btf::SampledBtf btf(info.header);
  for (int v = 0; v < info.header.view_count(); ++v) {
    for (int l = 0; l < info.header.light_count(); ++l) {
      if (info.present[btf.PairIndex(v, l)] == 0) continue;
      btf.SetPresent(v, l, true);
      encoded.DecodeImage(v, l, btf.MutableImage(v, l));
    }
  }
  return btf;
}

StatusOr<btf::SampledBtf> ReadAnyBtf(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo info, btf::ReadBtfInfo(path));
  if (info.codec == "raw") return btf::ReadSampledBtf(path);
  MESORIG_ASSIGN_OR_RETURN(const auto encoded, ReadEncodedBtf(path));
  MESORIG_RETURN_IF_ERROR(btf::CheckDenseMemory(info.header, path));
  return DecodeAll(*encoded);
}

}  // namespace mesorig::codecs
