#pragma once
// Small vectors and rigid transforms in double, for poses and directions (no Eigen here).
// Lengths in millimetres, angles in radians, right-handed, z up (DESIGN, "Frames").

#include <array>
#include <cmath>
#include <numbers>

namespace mesorig {

inline constexpr double kPi = std::numbers::pi;
constexpr double RadFromDeg(double degrees) { return degrees * (kPi / 180.0); }
constexpr double DegFromRad(double radians) { return radians * (180.0 / kPi); }

struct Vec3 {
  double x = 0, y = 0, z = 0;
  friend constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
  friend constexpr Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
  friend constexpr Vec3 operator*(Vec3 a, double s) { return s * a; }
  friend constexpr bool operator==(Vec3 a, Vec3 b) = default;
};
constexpr double Dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr Vec3 Cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double Norm(Vec3 a) { return std::sqrt(Dot(a, a)); }
// The zero vector has no direction: it is returned as it is.
inline Vec3 Normalized(Vec3 a) {
  const double n = Norm(a);
  return n > 0 ? (1 / n) * a : a;
}
// Angle between two unit vectors, radians; exact to rounding also near 0 and pi, where acos is not.
double AngleBetween(Vec3 a, Vec3 b);

// Unit vector at polar angle theta from +z and azimuth phi from +x, counter-clockwise.
Vec3 DirectionFromAngles(double theta_rad, double phi_rad);
// Inverse of the above; phi in [0, 2 pi), and 0 where theta is 0 or pi.
struct Angles {
  double theta_rad = 0, phi_rad = 0;
};
Angles AnglesFromDirection(Vec3 direction);

struct Mat3 {
  std::array<double, 9> m = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // row-major
  friend Vec3 operator*(const Mat3& a, Vec3 v) {
    return {a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
            a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z};
  }
  friend Mat3 operator*(const Mat3& a, const Mat3& b);
};
Mat3 Transposed(const Mat3& a);
// Rotation by `angle_rad` about the unit vector `axis`, counter-clockwise seen from its tip.
Mat3 RotationAbout(Vec3 axis, double angle_rad);

// p_in_target = rotation * p_in_source + translation.
struct RigidTransform {
  Mat3 rotation;
  Vec3 translation;  // mm
  Vec3 operator*(Vec3 p) const { return rotation * p + translation; }
  friend RigidTransform operator*(const RigidTransform& a, const RigidTransform& b) {
    return {a.rotation * b.rotation, a * b.translation};
  }
};
RigidTransform Inverse(const RigidTransform& t);

// Smallest distance between segments a0-a1 and b0-b1, mm.
double SegmentDistance(Vec3 a0, Vec3 a1, Vec3 b0, Vec3 b1);

}  // namespace mesorig
