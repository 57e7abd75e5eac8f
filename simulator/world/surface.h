#pragma once
// A material sample as a height field with reflectance: the ground truth of everything that the
// simulator shows. Sample frame, millimetres.

#include <array>
#include <functional>
#include <string>

namespace mesorig::world {

// f_r = diffuse / pi + specular * D G / (4 cos_l cos_v), D and G of GGX (Walter et al. 2007) with
// the height-correlated Smith term (Heitz 2014, Eq. 99). The specular colour does not rise towards
// grazing angles: a microfacet lobe of unit reflectance never returns more than it gets, so that
// diffuse + specular <= 1 conserves energy at every angle.
struct Material {
  std::array<double, 3> diffuse{};  // albedo, red green blue, 0..1
  double specular = 0;              // reflectance of the facets, 0..1
  double roughness = 0.3;           // GGX alpha, kMinRoughness..1
};
inline constexpr double kMinRoughness = 0.01;

// Functions are pure; they are called from several threads.
struct Surface {
  std::string name;
  double extent_mm = 0;  // a square plate, centred; what lies beyond is black
  double grid_mm = 0;    // edge of the height field's cells
  std::function<double(double x_mm, double y_mm)> height_mm;  // >= 0
  std::function<Material(double x_mm, double y_mm)> material;
};

}  // namespace mesorig::world
