#include <gtest/gtest.h>

#include <cmath>

#include "simulator/world/transport.h"

namespace mesorig::world {
namespace {

// The lobe as transport.cc evaluates it, for unit vectors and the normal +z.
double Lobe(Vec3 l, Vec3 v, double alpha) {
  const Vec3 h = Normalized(l + v);
  return SpecularLobe(static_cast<float>(l.z), static_cast<float>(v.z),
                      static_cast<float>(h.z * h.z), static_cast<float>(h.x * h.x + h.y * h.y), 1,
                      static_cast<float>(alpha * alpha));
}

// Directional albedo of the lobe with specular = 1: the integral over l of f cos(theta_l), in
// coordinates of the half vector (d omega_l = 4 (v.h) d omega_h), whose polar angle runs as
// tan(theta_h) = alpha sqrt(u / (1 - u)), so that the peak is resolved at every roughness.
double Albedo(double theta_v, double alpha) {
  const Vec3 v = DirectionFromAngles(theta_v, 0);
  const int nu = 600, nphi = 360;
  double sum = 0;
  for (int i = 0; i < nu; ++i) {
    const double u = (i + 0.5) / nu;
    const double tan2 = alpha * alpha * u / (1 - u);
    const double theta_h = std::atan(std::sqrt(tan2));
    // d(cos theta_h)/du with cos = (1 + tan^2)^(-1/2).
    const double d_tan2 = alpha * alpha / ((1 - u) * (1 - u));
    const double d_cos = 0.5 * d_tan2 * std::pow(1 + tan2, -1.5);
    for (int j = 0; j < nphi; ++j) {
      const Vec3 h = DirectionFromAngles(theta_h, 2 * kPi * (j + 0.5) / nphi);
      const double vh = Dot(v, h);
      if (vh <= 0) continue;
      const Vec3 l = 2 * vh * h - v;
      if (l.z <= 0) continue;
      sum += Lobe(l, v, alpha) * l.z * 4 * vh * d_cos * (2 * kPi / nphi) / nu;
    }
  }
  return sum;
}

TEST(Brdf, NeverReturnsMoreThanItGets) {
  for (double alpha : {kMinRoughness, 0.03, 0.1, 0.25, 0.35, 0.6, 1.0}) {
    for (double theta_deg : {0.0, 30.0, 60.0, 80.0, 89.0, 89.9}) {
      const double albedo = Albedo(RadFromDeg(theta_deg), alpha);
      EXPECT_LE(albedo, 1.002) << "alpha " << alpha << " theta " << theta_deg;
      EXPECT_GT(albedo, 0.3) << "alpha " << alpha << " theta " << theta_deg;
    }
  }
}

// A smooth mirror loses nothing: the quadrature itself is right.
TEST(Brdf, SmoothLobeKeepsAllItsEnergy) {
  EXPECT_NEAR(Albedo(0, kMinRoughness), 1, 2e-3);
  EXPECT_NEAR(Albedo(RadFromDeg(45), kMinRoughness), 1, 2e-3);
}

TEST(Brdf, IsReciprocalAndFinite) {
  for (double alpha : {kMinRoughness, 0.2, 1.0}) {
    for (int a = 0; a < 90; a += 7) {
      for (int b = 0; b < 90; b += 11) {
        const Vec3 l = DirectionFromAngles(RadFromDeg(a), 0.4);
        const Vec3 v = DirectionFromAngles(RadFromDeg(b), 3.3);
        const double f = Lobe(l, v, alpha);
        ASSERT_TRUE(std::isfinite(f) && f >= 0);
        ASSERT_NEAR(f, Lobe(v, l, alpha), 1e-6 * f);
      }
    }
  }
}

// At normal incidence and view, D = 1 / (pi alpha^2), G = 1: the peak is 1 / (4 pi alpha^2).
TEST(Brdf, PeakByHand) {
  EXPECT_NEAR(Lobe({0, 0, 1}, {0, 0, 1}, 0.1), 1 / (4 * kPi * 0.01), 1e-4);
}

}  // namespace
}  // namespace mesorig::world
