#pragma once
// The same fragments evaluated on the CPU, in double, by the codec's own Evaluate: what the shader
// adds or loses.

#include <vector>

#include "renderer/gl/btf_source.h"
#include "renderer/gl/scene_renderer.h"

namespace mesorig::renderer {

// Radiance of a fragment of a BTF object, exposure included: bilinear between the four texels
// around (u, v), repeating, over all lights of the scene.
std::array<double, 3> CpuRadiance(const Scene& scene, const BtfSource& source,
                                  const Fragment& fragment);

struct CpuCheck {
  size_t fragments = 0;  // compared
  double rel_error = 0;  // ||shader - cpu|| / ||cpu||
  double max_abs = 0;    // radiance, exposure included
  double cpu_ms = 0;     // for all of them, on one thread
};
// Compares at most `most` fragments of BTF objects, evenly spread over them. All zero when there is
// none.
CpuCheck CompareWithCpu(const Scene& scene, const BtfSource& source,
                        const std::vector<Fragment>& fragments, size_t most);

}  // namespace mesorig::renderer
