#pragma once
// Surfaces whose light can be computed by hand.

#include <memory>
#include <utility>

#include "simulator/world/world.h"

namespace mesorig::world {

inline Surface Plane(double height_mm, Material material, double extent_mm = 60) {
  Surface surface;
  surface.name = "plane";
  surface.extent_mm = extent_mm;
  surface.grid_mm = 1;
  surface.height_mm = [height_mm](double, double) { return height_mm; };
  surface.material = [material](double, double) { return material; };
  return surface;
}

inline Material Lambert(double red, double green, double blue) {
  Material material;
  material.diffuse = {red, green, blue};
  return material;
}

// A wall of height `step_mm` at x = 0: high for x < 0.
inline Surface Step(double step_mm, double grid_mm) {
  Surface surface = Plane(0, Lambert(0.5, 0.5, 0.5), 30);
  surface.name = "step";
  surface.grid_mm = grid_mm;
  surface.height_mm = [step_mm](double x, double) { return x < -1e-9 ? step_mm : 0.0; };
  return surface;
}

inline std::unique_ptr<World> Build(Surface surface) {
  return World::Build(std::move(surface)).value();
}

}  // namespace mesorig::world
