#pragma once
// The exact mesostructure distance function of a sample (Wang et al. 2005, Sec. 3, Fig. 2): from
// the texel's centre p on the reference plane the ray along -v meets the sample's triangles at p -
// D v.
//
// A ray that passes by the sample ends on the turntable, z = 0: its D = h_ref / v.z is written with
// confidence 0, because nothing of the sample is met there; all others have confidence 1.

#include <filesystem>
#include <functional>

#include "processing/btf/mdf.h"
#include "simulator/world/world.h"

namespace mesorig::world {

struct MdfTruth {
  btf::Mdf mdf;
  size_t missed = 0;  // texels of all views whose ray passes by the sample
  double seconds = 0;
};

// At the header's texel centres, along its nominal view directions everywhere. `progress` is
// optional, called between views. InvalidArgument when the header is not valid or the relief rises
// above its reference plane.
StatusOr<MdfTruth> ComputeMdfTruth(const World& world, const btf::MdfHeader& header, int threads,
                                   const std::function<void(double fraction)>& progress = {});

// The triangles that rays meet as a Wavefront OBJ: v in mm, sample frame, counter-clockwise from
// above; the rim falls to z = 0. A file is whole or absent.
Status WriteMesh(const World& world, const std::filesystem::path& path);

}  // namespace mesorig::world
