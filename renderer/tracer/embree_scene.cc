#include "renderer/tracer/embree_scene.h"

#include <cstring>
#include <limits>
#include <utility>

namespace mesorig::renderer {
namespace {

template <typename T>
bool CopyBuffer(RTCGeometry geometry, RTCBufferType type, RTCFormat format,
                const std::vector<T>& data) {
  void* buffer = rtcSetNewGeometryBuffer(geometry, type, 0, format, sizeof(T), data.size());
  if (buffer == nullptr) return false;
  std::memcpy(buffer, data.data(), data.size() * sizeof(T));
  return true;
}

void SetRay(Vec3 origin, Vec3 direction, float nearest, RTCRay& ray) {
  ray.org_x = static_cast<float>(origin.x);
  ray.org_y = static_cast<float>(origin.y);
  ray.org_z = static_cast<float>(origin.z);
  ray.dir_x = static_cast<float>(direction.x);
  ray.dir_y = static_cast<float>(direction.y);
  ray.dir_z = static_cast<float>(direction.z);
  ray.tnear = nearest;
  ray.tfar = std::numeric_limits<float>::infinity();
  ray.time = 0;
  ray.mask = ~0u;
  ray.id = 0;
  ray.flags = 0;
}

}  // namespace

StatusOr<EmbreeScene> EmbreeScene::Create(const std::vector<std::array<float, 3>>& vertices,
                                          const std::vector<std::array<uint32_t, 3>>& triangles) {
  EmbreeScene result;
  result.device_ = rtcNewDevice(nullptr);
  if (result.device_ == nullptr) {
    return Unavailable("Embree: no device (error {})",
                       static_cast<int>(rtcGetDeviceError(nullptr)));
  }
  result.scene_ = rtcNewScene(result.device_);
  rtcSetSceneFlags(result.scene_, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(result.device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  const bool copied = CopyBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, vertices) &&
                      CopyBuffer(geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, triangles);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(result.scene_, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(result.scene_);
  const RTCError error = rtcGetDeviceError(result.device_);
  if (!copied || error != RTC_ERROR_NONE) {
    return Unavailable("Embree: a scene of {} triangles: error {}", triangles.size(),
                       static_cast<int>(error));
  }
  return result;
}

EmbreeScene::EmbreeScene(EmbreeScene&& other) noexcept
    : device_(std::exchange(other.device_, nullptr)),
      scene_(std::exchange(other.scene_, nullptr)) {}

EmbreeScene& EmbreeScene::operator=(EmbreeScene&& other) noexcept {
  std::swap(device_, other.device_);
  std::swap(scene_, other.scene_);
  return *this;
}

EmbreeScene::~EmbreeScene() {
  if (scene_ != nullptr) rtcReleaseScene(scene_);
  if (device_ != nullptr) rtcReleaseDevice(device_);
}

EmbreeScene::Hit EmbreeScene::Intersect(Vec3 origin, Vec3 direction, float nearest) const {
  RTCRayHit query{};
  SetRay(origin, direction, nearest, query.ray);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene_, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
  return {true,        query.ray.tfar, query.hit.primID,
          query.hit.u, query.hit.v,    {query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z}};
}

bool EmbreeScene::Occluded(Vec3 origin, Vec3 direction, float nearest) const {
  RTCRay ray{};
  SetRay(origin, direction, nearest, ray);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(scene_, &context, &ray);
  return ray.tfar < 0;
}

}  // namespace mesorig::renderer
