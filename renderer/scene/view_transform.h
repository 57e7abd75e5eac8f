#pragma once
// The pinhole camera as OpenGL wants it.

#include <array>

#include "renderer/scene/scene.h"

namespace mesorig::renderer {

using Matrix4 = std::array<double, 16>;  // column-major, as OpenGL takes it

Matrix4 Product(const Matrix4& a, const Matrix4& b);
Matrix4 FromRigid(const RigidTransform& transform);
// Camera frame: x right, y up, looks along -z.
Matrix4 CameraFromWorld(const Camera& camera);
// Clip space from the camera frame; near and far follow from the camera's distance to its target.
Matrix4 Projection(const Camera& camera, double aspect);
// Pixel coordinates (x right, y down, origin at the picture's top left corner) of a world point
// before the camera.
std::array<double, 2> PixelOf(const Camera& camera, int width, int height, Vec3 p_in_world);
// Unit vector from the eye through the pixel coordinates (x, y): the inverse of PixelOf.
Vec3 RayThrough(const Camera& camera, int width, int height, double x, double y);

}  // namespace mesorig::renderer
