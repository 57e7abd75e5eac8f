#include "processing/btf/mdf.h"

#include <cmath>

#include "processing/btf/sampled_btf.h"

namespace mesorig::btf {

Status CheckMdfHeader(const MdfHeader& header) {
  if (!(header.pitch_mm > 0 && header.h_ref_mm > 0)) {
    return InvalidArgument("MDF: pitch {} mm and h_ref {} mm must be positive", header.pitch_mm,
                           header.h_ref_mm);
  }
  // What it shares with a BTF is checked as one with a single light.
  BtfHeader shared;
  shared.width = header.width;
  shared.height = header.height;
  shared.pitch_mm = header.pitch_mm;
  shared.h_ref_mm = header.h_ref_mm;
  shared.views = header.views;
  shared.view_positions_mm = header.view_positions_mm;
  shared.lights = {Vec3{0, 0, 1}};
  MESORIG_RETURN_IF_ERROR(CheckHeader(shared));
  for (int v = 0; v < header.view_count(); ++v) {
    if (!(header.views[v].z >= 0.01)) {
      return InvalidArgument("MDF: view {} does not look up (z = {}, at least 0.01)", v,
                             header.views[v].z);
    }
  }
  return OkStatus();
}

Mdf::Mdf(MdfHeader header) : header_(std::move(header)) {
  const size_t values = header_.texel_count() * header_.views.size();
  distance_.assign(values, 0.0f);
  confidence_.assign(values, 0.0f);
}

}  // namespace mesorig::btf
