#pragma once
// A relief with a known answer to everything: a height field of steep domes on low waves, its exact
// MDF, its BTF and its mesh.

#include <string>

#include "processing/btf/mdf.h"
#include "processing/btf/sampled_btf.h"

namespace mesorig::renderer {

// The sample: 40 mm square, repeating, its lowest point at 1.2 mm, the reference plane at 5 mm.
inline constexpr double kDomesSize = 40, kDomesReference = 5, kDomesLowest = 1.2;

double DomesHeight(double x_mm, double y_mm);
// By marching the ray, to 0.02 um.
btf::Mdf DomesMdf(int texels, const std::vector<Vec3>& views);
// Lambert, with the shadows of the relief.
btf::SampledBtf DomesBtf(int texels, const std::vector<Vec3>& views,
                         const std::vector<Vec3>& lights);
// A Wavefront OBJ of `cells` x `cells` squares of two triangles.
std::string DomesObj(int cells);

}  // namespace mesorig::renderer
