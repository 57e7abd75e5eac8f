#include "renderer/tracer/tracer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "renderer/scene/view_transform.h"

namespace mesorig::renderer {
namespace {

// Calls row(y) for every row, on all cores.
template <typename Row>
void ForEachRow(int height, const Row& row) {
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int y = next++; y < height; y = next++) row(y);
  };
  std::vector<std::jthread> threads;
  for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) threads.emplace_back(work);
  work();
}

// The texture at repeats (u, v), bilinear between texel centres.
Vec3 Sample(const AlbedoTexture& texture, double u, double v) {
  const double x = (u - std::floor(u)) * texture.width - 0.5;
  const double y = (v - std::floor(v)) * texture.height - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  Vec3 sum;
  for (int k = 0; k < 4; ++k) {
    const int dx = k % 2, dy = k / 2;
    const int column = (static_cast<int>(x0) + dx + texture.width) % texture.width;
    const int row = (static_cast<int>(y0) + dy + texture.height) % texture.height;
    const double weight = (dx ? x - x0 : 1 - (x - x0)) * (dy ? y - y0 : 1 - (y - y0));
    const size_t at = static_cast<size_t>(row * texture.width + column) * 3;
    sum = sum + weight * Vec3{texture.rgb[at], texture.rgb[at + 1], texture.rgb[at + 2]};
  }
  return sum;
}

Vec3 Times(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

Vec3 Clamped(Vec3 v) {
  return {std::clamp(v.x, 0.0, 1.0), std::clamp(v.y, 0.0, 1.0), std::clamp(v.z, 0.0, 1.0)};
}

// sRGB, IEC 61966-2-1.
uint8_t Encoded(double linear) {
  const double c = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
  return static_cast<uint8_t>(std::lround(255 * std::clamp(c, 0.0, 1.0)));
}

}  // namespace

StatusOr<Tracer> Tracer::Create(std::vector<SurfaceMesh> meshes) {
  std::vector<Surface> surfaces;
  for (SurfaceMesh& mesh : meshes) {
    MESORIG_ASSIGN_OR_RETURN(EmbreeScene scene, EmbreeScene::Create(mesh.vertices, mesh.triangles));
    surfaces.push_back({std::move(mesh), std::move(scene)});
  }
  return Tracer(std::move(surfaces));
}

size_t Tracer::triangle_count() const {
  size_t count = 0;
  for (const Surface& surface : surfaces_) count += surface.mesh.triangles.size();
  return count;
}

Tracer::Hit Tracer::Nearest(Vec3 origin, Vec3 direction) const {
  Hit nearest;
  for (const Surface& surface : surfaces_) {
    const EmbreeScene::Hit hit = surface.scene.Intersect(origin, direction, 0);
    if (hit.any && (nearest.surface == nullptr || hit.t < nearest.hit.t)) nearest = {&surface, hit};
  }
  return nearest;
}

bool Tracer::InShadow(Vec3 origin, Vec3 direction) const {
  return std::any_of(surfaces_.begin(), surfaces_.end(), [&](const Surface& surface) {
    return surface.scene.Occluded(origin, direction, 0);
  });
}

std::vector<uint8_t> Tracer::Mask(const Scene& scene) const {
  const int width = scene.image.width, height = scene.image.height;
  std::vector<uint8_t> mask(static_cast<size_t>(width) * static_cast<size_t>(height));
  ForEachRow(height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const Vec3 direction = RayThrough(scene.camera, width, height, x + 0.5, y + 0.5);
      const bool hit = Nearest(scene.camera.eye_mm, direction).surface != nullptr;
      mask[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)] = hit;
    }
  });
  return mask;
}

Vec3 Tracer::Radiance(const Scene& scene, const AlbedoTexture& albedo, Vec3 direction,
                      const Hit& found) const {
  const auto& [surface, hit] = found;
  const auto& corners = surface->mesh.triangles[hit.triangle];
  double uv[2];
  for (size_t k = 0; k < 2; ++k) {
    uv[k] = (1.0 - hit.b - hit.c) * surface->mesh.uv[corners[0]][k] +
            hit.b * surface->mesh.uv[corners[1]][k] + hit.c * surface->mesh.uv[corners[2]][k];
  }
  const Vec3 reflectance = Sample(albedo, uv[0], uv[1]);
  Vec3 normal = Normalized(hit.normal);
  if (Dot(normal, direction) > 0) normal = -normal;
  // Off the facet by more than a float's rounding at this distance.
  const Vec3 p = scene.camera.eye_mm + double{hit.t} * direction + 1e-5 * hit.t * normal;
  Vec3 radiance;
  for (const DirectionalLight& light : scene.lights) {
    const double cosine = Dot(normal, light.direction);
    if (cosine <= 0 || InShadow(p, light.direction)) continue;
    radiance = radiance + cosine * Times(light.irradiance, reflectance);
  }
  return scene.image.exposure * radiance;
}

Picture Tracer::Draw(const Scene& scene, const AlbedoTexture& albedo) const {
  const ImageSettings& image = scene.image;
  const int samples = image.supersample;
  Picture picture{image.width, image.height, {}};
  picture.rgb.resize(static_cast<size_t>(image.width) * static_cast<size_t>(image.height) * 3);
  ForEachRow(image.height, [&](int y) {
    for (int x = 0; x < image.width; ++x) {
      Vec3 sum;
      for (int k = 0; k < samples * samples; ++k) {
        const double px = x + (k % samples + 0.5) / samples;
        const double py = y + (double{1} * (k / samples) + 0.5) / samples;
        const Vec3 direction = RayThrough(scene.camera, image.width, image.height, px, py);
        const Hit hit = Nearest(scene.camera.eye_mm, direction);
        const double down = py / image.height;
        const Vec3 background = (1 - down) * image.background_top + down * image.background_bottom;
        sum = sum + Clamped(hit.surface ? Radiance(scene, albedo, direction, hit) : background);
      }
      sum = (1.0 / (samples * samples)) * sum;
      const size_t at =
          (static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x)) * 3;
      picture.rgb[at] = Encoded(sum.x);
      picture.rgb[at + 1] = Encoded(sum.y);
      picture.rgb[at + 2] = Encoded(sum.z);
    }
  });
  return picture;
}

}  // namespace mesorig::renderer
