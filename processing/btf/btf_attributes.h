#pragma once
// Internal to processing/btf: BtfFileInfo as attributes of part 0. Names and meaning are listed in
// README.md.

#include <OpenEXR/ImfHeader.h>

#include "processing/btf/btf_file.h"

namespace mesorig::btf {

// InvalidArgument when info.header fails CheckHeader, the presence does not match it, or JSON is
// not JSON.
Status CheckInfo(const BtfFileInfo& info);
// `info` has passed CheckInfo.
void PutAttributes(const BtfFileInfo& info, Imf::Header& header);
// Everything but mask and file_bytes. InvalidArgument names `file` and the attribute.
StatusOr<BtfFileInfo> GetAttributes(const Imf::Header& header, const std::string& file);
// Whether part 0 has a channel `mask`.
bool HasMask(const Imf::Header& header);

}  // namespace mesorig::btf
