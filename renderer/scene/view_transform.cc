#include "renderer/scene/view_transform.h"

#include <cmath>

namespace mesorig::renderer {

Matrix4 Product(const Matrix4& a, const Matrix4& b) {
  Matrix4 c{};
  for (size_t column = 0; column < 4; ++column) {
    for (size_t row = 0; row < 4; ++row) {
      for (size_t k = 0; k < 4; ++k) c[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
    }
  }
  return c;
}

Matrix4 FromRigid(const RigidTransform& transform) {
  const auto& m = transform.rotation.m;
  const Vec3 t = transform.translation;
  return {m[0], m[3], m[6], 0, m[1], m[4], m[7], 0, m[2], m[5], m[8], 0, t.x, t.y, t.z, 1};
}

Matrix4 CameraFromWorld(const Camera& camera) {
  const Vec3 back = Normalized(camera.eye_mm - camera.target_mm);
  const Vec3 right = Normalized(Cross(camera.up, back));
  const Vec3 up = Cross(back, right);
  const Vec3 eye = camera.eye_mm;
  // clang-format off
  return {right.x, up.x, back.x, 0,
          right.y, up.y, back.y, 0,
          right.z, up.z, back.z, 0,
          -Dot(right, eye), -Dot(up, eye), -Dot(back, eye), 1};
  // clang-format on
}

Matrix4 Projection(const Camera& camera, double aspect) {
  const double distance = Norm(camera.eye_mm - camera.target_mm);
  const double near = distance / 100, far = distance * 20;
  const double f = 1 / std::tan(camera.fov_rad / 2);
  // clang-format off
  return {f / aspect, 0, 0, 0,
          0, f, 0, 0,
          0, 0, (far + near) / (near - far), -1,
          0, 0, 2 * far * near / (near - far), 0};
  // clang-format on
}

std::array<double, 2> PixelOf(const Camera& camera, int width, int height, Vec3 p_in_world) {
  const Matrix4 m =
      Product(Projection(camera, static_cast<double>(width) / height), CameraFromWorld(camera));
  const auto row = [&](size_t r) {
    return m[r] * p_in_world.x + m[4 + r] * p_in_world.y + m[8 + r] * p_in_world.z + m[12 + r];
  };
  const double w = row(3);
  return {(row(0) / w + 1) / 2 * width, (1 - row(1) / w) / 2 * height};
}

Vec3 RayThrough(const Camera& camera, int width, int height, double x, double y) {
  const Vec3 forward = Normalized(camera.target_mm - camera.eye_mm);
  const Vec3 right = Normalized(Cross(forward, camera.up));
  const Vec3 up = Cross(right, forward);
  const double pixel = 2 * std::tan(camera.fov_rad / 2) / height;
  return Normalized(forward + (x - width / 2.0) * pixel * right + (height / 2.0 - y) * pixel * up);
}

}  // namespace mesorig::renderer
