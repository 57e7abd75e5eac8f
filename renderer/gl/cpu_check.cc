#include "renderer/gl/cpu_check.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "processing/codecs/space_filter.h"

namespace mesorig::renderer {
namespace {

double Component(Vec3 v, size_t c) { return c == 0 ? v.x : c == 1 ? v.y : v.z; }

}  // namespace

std::array<double, 3> CpuRadiance(const Scene& scene, const BtfSource& source,
                                  const Fragment& fragment) {
  const Vec3 bitangent = Cross(fragment.normal, fragment.tangent);
  std::array<double, 3> radiance{};
  for (const DirectionalLight& light : scene.lights) {
    const Vec3 l = {Dot(light.direction, fragment.tangent), Dot(light.direction, bitangent),
                    Dot(light.direction, fragment.normal)};
    if (l.z <= 0) continue;
    const btf::BtfHeader& header = source.header();
    const auto value = codecs::FilteredInSpace(
        header.width, header.height,
        [&](int x, int y) { return source.Evaluate(x, y, fragment.view, l); }, fragment.u,
        fragment.v, 0);
    for (size_t c = 0; c < 3; ++c) {
      radiance[c] +=
          scene.image.exposure * Component(light.irradiance, c) * std::max(value[c], 0.0);
    }
  }
  return radiance;
}

CpuCheck CompareWithCpu(const Scene& scene, const BtfSource& source,
                        const std::vector<Fragment>& fragments, size_t most) {
  std::vector<const Fragment*> of_btf;
  for (const Fragment& fragment : fragments) {
    if (scene.objects[static_cast<size_t>(fragment.object)].material != Material::kPlain) {
      of_btf.push_back(&fragment);
    }
  }
  CpuCheck check;
  check.fragments = std::min(most, of_btf.size());
  double difference = 0, reference = 0;
  const auto start = std::chrono::steady_clock::now();
  for (size_t i = 0; i < check.fragments; ++i) {
    const Fragment& fragment = *of_btf[i * of_btf.size() / check.fragments];
    const auto cpu = CpuRadiance(scene, source, fragment);
    for (size_t c = 0; c < 3; ++c) {
      const double error = fragment.radiance[c] - cpu[c];
      difference += error * error;
      reference += cpu[c] * cpu[c];
      check.max_abs = std::max(check.max_abs, std::abs(error));
    }
  }
  check.cpu_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  if (reference > 0) check.rel_error = std::sqrt(difference / reference);
  return check;
}

}  // namespace mesorig::renderer
