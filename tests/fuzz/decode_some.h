#pragma once
// What a fuzz target does with a compressed BTF that a decoder has accepted.

#include <algorithm>
#include <cmath>

#include "processing/codecs/codec.h"
#include "tests/fuzz/fuzz_target.h"

namespace mesorig::fuzz {

// Random access at nodes, between them and below the horizon; images; and, where it is small, the
// decoder for shaders. All that comes out is finite.
inline void DecodeSome(const codecs::EncodedBtf& encoded) {
  const btf::BtfHeader& h = encoded.info().header;
  const auto finite = [](const auto& values) {
    return std::all_of(values.begin(), values.end(), [](float x) { return std::isfinite(x); });
  };
  const Vec3 directions[] = {h.views[0], h.lights.back(), {0, 0, 1}, Normalized({0.3, -0.4, 0.5}),
                             Normalized({1, 2, -0.1})};
  for (const Vec3& v : directions) {
    for (const Vec3& l : directions) {
      MESORIG_CHECK(finite(encoded.Evaluate(h.width - 1, h.height / 2, v, l)));
    }
  }
  std::vector<float> image(3 * h.texel_count());
  for (const auto& [view, light] :
       {std::pair(0, 0), std::pair(h.view_count() - 1, h.light_count() - 1)}) {
    encoded.DecodeImage(view, light, image);
    MESORIG_CHECK(finite(image));
  }
  (void)encoded.PredictImage(0, Normalized({0.1, 0.2, 0.9}), image);
  constexpr size_t kSmall = 1 << 14;  // mip levels are fitted: the square of this is work
  size_t values = 0;
  for (const btf::Plane& plane : encoded.Planes()) values += plane.values.size();
  if (values > kSmall) return;
  const auto shader = encoded.ToShader();
  if (!shader) return;
  MESORIG_CHECK(shader->rgb.size() == static_cast<size_t>(shader->layers) * h.texel_count() * 3);
  MESORIG_CHECK(finite(shader->rgb) && finite(shader->table));
}

}  // namespace mesorig::fuzz
