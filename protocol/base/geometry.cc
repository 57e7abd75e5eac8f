#include "protocol/base/geometry.h"

#include <algorithm>

namespace mesorig {

double AngleBetween(Vec3 a, Vec3 b) {
  // Kahan: 2 atan2(|a-b|, |a+b|) loses no digits for parallel or opposite vectors.
  return 2 * std::atan2(Norm(a - b), Norm(a + b));
}

Vec3 DirectionFromAngles(double theta_rad, double phi_rad) {
  const double s = std::sin(theta_rad);
  return {s * std::cos(phi_rad), s * std::sin(phi_rad), std::cos(theta_rad)};
}

Angles AnglesFromDirection(Vec3 d) {
  const double r = std::hypot(d.x, d.y);
  if (r < 1e-12) return {d.z >= 0 ? 0.0 : kPi, 0.0};
  double phi = std::atan2(d.y, d.x);
  if (phi < 0) phi += 2 * kPi;
  return {std::atan2(r, d.z), phi};
}

Mat3 operator*(const Mat3& a, const Mat3& b) {
  Mat3 c;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      c.m[3 * i + j] =
          a.m[3 * i] * b.m[j] + a.m[3 * i + 1] * b.m[3 + j] + a.m[3 * i + 2] * b.m[6 + j];
    }
  }
  return c;
}

Mat3 Transposed(const Mat3& a) {
  return {{a.m[0], a.m[3], a.m[6], a.m[1], a.m[4], a.m[7], a.m[2], a.m[5], a.m[8]}};
}

Mat3 RotationAbout(Vec3 u, double angle_rad) {  // Rodrigues
  const double c = std::cos(angle_rad), s = std::sin(angle_rad), k = 1 - c;
  return {{c + u.x * u.x * k, u.x * u.y * k - u.z * s, u.x * u.z * k + u.y * s,
           u.y * u.x * k + u.z * s, c + u.y * u.y * k, u.y * u.z * k - u.x * s,
           u.z * u.x * k - u.y * s, u.z * u.y * k + u.x * s, c + u.z * u.z * k}};
}

RigidTransform Inverse(const RigidTransform& t) {
  const Mat3 r = Transposed(t.rotation);
  return {r, -(r * t.translation)};
}

double SegmentDistance(Vec3 a0, Vec3 a1, Vec3 b0, Vec3 b1) {
  // Ericson 2005, "Real-Time Collision Detection", 5.1.9: closest points of two segments.
  const Vec3 d1 = a1 - a0, d2 = b1 - b0, r = a0 - b0;
  const double a = Dot(d1, d1), e = Dot(d2, d2), f = Dot(d2, r);
  double s = 0, t = 0;
  if (a > 0 && e > 0) {
    const double c = Dot(d1, r), b = Dot(d1, d2), denominator = a * e - b * b;
    // Parallel segments (denominator 0 to rounding): any s will do.
    s = denominator > 1e-12 * a * e ? std::clamp((b * f - c * e) / denominator, 0.0, 1.0) : 0.0;
    t = (b * s + f) / e;
    if (t < 0) {
      t = 0;
      s = std::clamp(-c / a, 0.0, 1.0);
    } else if (t > 1) {
      t = 1;
      s = std::clamp((b - c) / a, 0.0, 1.0);
    }
  } else if (a > 0) {
    s = std::clamp(-Dot(d1, r) / a, 0.0, 1.0);
  } else if (e > 0) {
    t = std::clamp(f / e, 0.0, 1.0);
  }
  return Norm((a0 + s * d1) - (b0 + t * d2));
}

}  // namespace mesorig
