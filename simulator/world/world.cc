#include "simulator/world/world.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

namespace mesorig::world {
namespace {

// Rays start this far outside the box around the sample.
constexpr double kMarginMm = 0.01;

int CellsPerSide(const Surface& surface) {
  return static_cast<int>(std::ceil(surface.extent_mm / surface.grid_mm - 1e-9));
}

}  // namespace

struct World::Embree {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Embree() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

World::World(Surface surface) : surface_(std::move(surface)) {}
World::~World() = default;

StatusOr<std::unique_ptr<World>> World::Build(Surface surface) {
  const double cells = surface.extent_mm / surface.grid_mm;
  if (!(surface.extent_mm > 0 && surface.grid_mm > 0 && cells >= 2 && cells <= 4096)) {
    return InvalidArgument("sample {}: {} mm in cells of {} mm: permitted is 2 to 4096 cells",
                           surface.name, surface.extent_mm, surface.grid_mm);
  }
  std::unique_ptr<World> world(new World(std::move(surface)));
  MESORIG_RETURN_IF_ERROR(world->BuildTriangles());
  return world;
}

Status World::BuildTriangles() {
  embree_ = std::make_unique<Embree>();
  // One instruction set and one building thread: equal inputs give equal trees, hence equal hits
  // to the last bit, on every machine that runs the program.
  embree_->device = rtcNewDevice("isa=avx2,threads=1");
  if (embree_->device == nullptr) {
    return Internal("Embree: no device (error {})", static_cast<int>(rtcGetDeviceError(nullptr)));
  }
  embree_->scene = rtcNewScene(embree_->device);
  rtcSetSceneFlags(embree_->scene, RTC_SCENE_FLAG_ROBUST);
  const int n = CellsPerSide(surface_);
  const double step = surface_.extent_mm / n;
  RTCGeometry geometry = rtcNewGeometry(embree_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              3 * sizeof(float), static_cast<size_t>(n + 1) * (n + 1)));
  auto* triangles = static_cast<unsigned*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(unsigned), 2 * static_cast<size_t>(n) * n));
  if (vertices == nullptr || triangles == nullptr) {
    rtcReleaseGeometry(geometry);
    return Internal("Embree: no memory for {} triangles", 2 * static_cast<size_t>(n) * n);
  }
  Status status;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      const double x = i * step - surface_.extent_mm / 2, y = j * step - surface_.extent_mm / 2;
      // The rim lies on the turntable: the plate has walls, and no ray gets beneath it.
      const bool rim = i == 0 || j == 0 || i == n || j == n;
      const double z = rim ? 0.0 : surface_.height_mm(x, y);
      if (!(z >= 0 && z < 1e4)) {
        status = InvalidArgument("sample {}: height {} mm at ({}, {}) mm is not in [0, 1e4)",
                                 surface_.name, z, x, y);
      }
      *vertices++ = static_cast<float>(x);
      *vertices++ = static_cast<float>(y);
      *vertices++ = static_cast<float>(z);
      top_mm_ = std::max(top_mm_, z);
    }
  }
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      const unsigned a = static_cast<unsigned>(j * (n + 1) + i), b = a + 1;
      const unsigned c = a + static_cast<unsigned>(n + 1), d = c + 1;
      for (unsigned index : {a, b, c, b, d, c}) *triangles++ = index;
    }
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(embree_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(embree_->scene);
  const RTCError error = rtcGetDeviceError(embree_->device);
  if (error != RTC_ERROR_NONE) return Internal("Embree: error {}", static_cast<int>(error));
  return status;
}

TriangleMesh World::Mesh() const {
  const RTCGeometry geometry = rtcGetGeometry(embree_->scene, 0);
  const auto* vertices = static_cast<const float*>(
      rtcGetGeometryBufferData(geometry, RTC_BUFFER_TYPE_VERTEX, 0));
  const auto* triangles = static_cast<const unsigned*>(
      rtcGetGeometryBufferData(geometry, RTC_BUFFER_TYPE_INDEX, 0));
  const auto n = static_cast<size_t>(CellsPerSide(surface_));
  TriangleMesh mesh;
  mesh.vertices.resize((n + 1) * (n + 1));
  mesh.triangles.resize(2 * n * n);
  std::memcpy(mesh.vertices.data(), vertices, mesh.vertices.size() * sizeof(mesh.vertices[0]));
  std::memcpy(mesh.triangles.data(), triangles, mesh.triangles.size() * sizeof(mesh.triangles[0]));
  return mesh;
}

std::optional<SurfaceHit> World::FirstHit(Vec3 origin, Vec3 direction) const {
  const Vec3 sum = origin + direction;
  if (!std::isfinite(sum.x + sum.y + sum.z)) return std::nullopt;
  // Enter at the box around the sample, in double: single precision then covers some 10 mm only.
  const double half = surface_.extent_mm / 2 + kMarginMm;
  double near = 0, far = std::numeric_limits<double>::infinity();
  const auto clip = [&](double o, double d, double low, double high) {
    if (d == 0) {
      if (o < low || o > high) far = -1;
      return;
    }
    const double t0 = (low - o) / d, t1 = (high - o) / d;
    near = std::max(near, std::min(t0, t1));
    far = std::min(far, std::max(t0, t1));
  };
  clip(origin.x, direction.x, -half, half);
  clip(origin.y, direction.y, -half, half);
  clip(origin.z, direction.z, -kMarginMm, top_mm_ + kMarginMm);
  if (!(near <= far)) return std::nullopt;
  const Vec3 start = origin + near * direction;
  RTCRayHit ray{};
  ray.ray.org_x = static_cast<float>(start.x);
  ray.ray.org_y = static_cast<float>(start.y);
  ray.ray.org_z = static_cast<float>(start.z);
  ray.ray.dir_x = static_cast<float>(direction.x);
  ray.ray.dir_y = static_cast<float>(direction.y);
  ray.ray.dir_z = static_cast<float>(direction.z);
  ray.ray.tfar = std::numeric_limits<float>::infinity();
  ray.ray.mask = ~0u;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(embree_->scene, &context, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  SurfaceHit hit;
  hit.normal = Normalized({ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z});
  if (hit.normal.z < 0) hit.normal = -hit.normal;  // a height field's outside is up
  if (!(Dot(hit.normal, direction) < 0)) return std::nullopt;
  hit.p = start + static_cast<double>(ray.ray.tfar) * direction;
  hit.material = surface_.material(hit.p.x, hit.p.y);
  return hit;
}

void World::Occluded(Rays8& rays) const {
  RTCRay8 ray;
  std::copy_n(rays.ox, 8, ray.org_x);
  std::copy_n(rays.oy, 8, ray.org_y);
  std::copy_n(rays.oz, 8, ray.org_z);
  std::copy_n(rays.dx, 8, ray.dir_x);
  std::copy_n(rays.dy, 8, ray.dir_y);
  std::copy_n(rays.dz, 8, ray.dir_z);
  std::copy_n(rays.length, 8, ray.tfar);
  for (int k = 0; k < 8; ++k) {
    ray.tnear[k] = 0;
    ray.time[k] = 0;
    ray.mask[k] = ~0u;
    ray.id[k] = 0;
    ray.flags[k] = 0;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded8(rays.active, embree_->scene, &context, &ray);
  for (int k = 0; k < 8; ++k) rays.occluded[k] = ray.tfar[k] < 0 ? 1 : 0;
}

}  // namespace mesorig::world
