#pragma once
// BTFs and scenes made for tests.

#include <functional>

#include "processing/btf/mdf.h"
#include "processing/btf/sampled_btf.h"
#include "renderer/scene/scene.h"

namespace mesorig::renderer {

// Directions on rings of polar angles up to max_theta, `spacing` apart (rad), the pole included.
std::vector<Vec3> Rings(double max_theta_rad, double spacing_rad);

// value(x, y, v, l) for every texel and pair, in all channels times (1, 0.8, 0.6).
btf::SampledBtf MakeBtf(int width, int height, double pitch_mm, const std::vector<Vec3>& views,
                        const std::vector<Vec3>& lights,
                        const std::function<double(int, int, Vec3, Vec3)>& value);

// A relief of bumps with texture and a highlight: nothing about it is symmetric.
btf::SampledBtf MakeBumpyBtf(int size, const std::vector<Vec3>& views,
                             const std::vector<Vec3>& lights);

// distance(x, y, v) mm for every texel and view; h_ref 5 mm, confidence 1.
btf::Mdf MakeMdf(int size, double pitch_mm, const std::vector<Vec3>& views,
                 const std::function<double(int, int, Vec3)>& distance);

// One object under one light of irradiance pi.
Scene TorusScene(Vec3 light);
Scene SlabFromAboveScene(Vec3 light);  // size 60 x 60 x 10 around the origin, camera up +y

}  // namespace mesorig::renderer
