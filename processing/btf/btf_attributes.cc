#include "processing/btf/btf_attributes.h"

#include <OpenEXR/ImfChannelList.h>

#include <cmath>

#include "processing/btf/exr_attributes.h"

namespace mesorig::btf {

Status CheckInfo(const BtfFileInfo& info) {
  MESORIG_RETURN_IF_ERROR(CheckHeader(info.header));
  const size_t pairs = info.header.views.size() * info.header.lights.size();
  if (info.present.size() != pairs) {
    return InvalidArgument("presence of {} pairs for {} views x {} lights", info.present.size(),
                           info.header.views.size(), info.header.lights.size());
  }
  if (!std::isfinite(info.value_scale) || info.value_scale <= 0) {
    return InvalidArgument("value scale {} is not a finite number > 0", info.value_scale);
  }
  if (info.codec.empty() || info.codec.size() > 64) {
    return InvalidArgument("codec name of {} bytes, permitted are 1 to 64", info.codec.size());
  }
  MESORIG_RETURN_IF_ERROR(CheckText("primaries", info.header.primaries, false));
  MESORIG_RETURN_IF_ERROR(CheckText("provenance", info.header.provenance_json, true));
  return CheckText("codec options", info.codec_options_json, true);
}

void PutAttributes(const BtfFileInfo& info, Imf::Header& header) {
  AttributeWriter put(header);
  const BtfHeader& h = info.header;
  put.Text("format", kBtfFormat);
  put.Number("formatMajor", kFormatMajor);
  put.Number("formatMinor", kFormatMinor);
  put.Text("codec", info.codec);
  put.Number("codecVersion", info.codec_version);
  put.Text("codecOptions", info.codec_options_json);
  put.Number("btfWidth", h.width);
  put.Number("btfHeight", h.height);
  put.Real("pitchMm", h.pitch_mm);
  put.Real("hRefMm", h.h_ref_mm);
  put.Points("views", h.views);
  put.Points("lights", h.lights);
  put.Points("viewPositionsMm", h.view_positions_mm);
  put.Points("lightPositionsMm", h.light_positions_mm);
  put.Flag("cosineIncluded", h.cosine_included);
  put.Flag("calibrated", h.calibrated);
  put.Text("primaries", h.primaries);
  put.Text("provenance", h.provenance_json);
  put.Real("valueScale", info.value_scale);
  if (info.clamp_negative) put.Flag("clampNegative", true);
  std::string presence(info.present.size(), '0');
  for (size_t i = 0; i < presence.size(); ++i) {
    if (info.present[i] != 0) presence[i] = '1';
  }
  put.Text("presence", presence);
}

StatusOr<BtfFileInfo> GetAttributes(const Imf::Header& header, const std::string& file) {
  AttributeReader get(header, file);
  get.Format(kBtfFormat, kFormatMajor);
  BtfFileInfo info;
  BtfHeader& h = info.header;
  std::string presence;
  get.Text("codec", info.codec);
  get.Number("codecVersion", info.codec_version);
  get.Text("codecOptions", info.codec_options_json);
  get.Number("btfWidth", h.width);
  get.Number("btfHeight", h.height);
  get.Real("pitchMm", h.pitch_mm);
  get.Real("hRefMm", h.h_ref_mm);
  get.Points("views", h.views);
  get.Points("lights", h.lights);
  get.Points("viewPositionsMm", h.view_positions_mm);
  get.Points("lightPositionsMm", h.light_positions_mm);
  get.Flag("cosineIncluded", h.cosine_included);
  get.Flag("calibrated", h.calibrated);
  get.Text("primaries", h.primaries);
  get.Text("provenance", h.provenance_json);
  get.Real("valueScale", info.value_scale);
  get.Text("presence", presence);
  if (header.find("clampNegative") != header.end()) get.Flag("clampNegative", info.clamp_negative);
  MESORIG_RETURN_IF_ERROR(get.status());
  for (const char flag : presence) {
    if (flag != '0' && flag != '1') {
      return InvalidArgument("{}: attribute presence holds something else than 0 and 1", file);
    }
    info.present.push_back(flag == '1' ? 1 : 0);
  }
  const Status status = CheckInfo(info);
  if (!status.ok()) return Annotate(status, file);
  return info;
}

bool HasMask(const Imf::Header& header) {
  return header.channels().findChannel("mask") != nullptr;
}

}  // namespace mesorig::btf
