#pragma once
// The model of svd2, hf and cmf (README.md): each texel is a product of sums of products of functions
// of two parameters each. Müller et al. 2004, Eq. 10, of which Eqs. 8 and 9 are special cases.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "processing/btf/sampled_btf.h"

namespace mesorig::codecs::per_texel {

// What a factor is a function of.
enum class Axis {
  kNone,        // nothing: it is 1 and not stored
  kView, kLight,  // the measured directions
  kHalf,        // h = (v + l) / |v + l|, on a grid
  kDifference,  // l as seen from h: turned by what turns h to +z on the shortest way; on a grid
};
inline constexpr int kGrid = 8;  // nodes a side: a concentric map of the hemisphere (Shirley, Chiu 1997)

// sum over terms k of P_k(p) Q_k(q): P is one number, Q is RGB.
struct Stage {
  Axis p = Axis::kView, q = Axis::kLight;
  int terms = 1;
};
inline constexpr size_t kMaxStages = 2;

// Where the tables of a texel stand: [stage][P: term, node][Q: term, node, rgb]. Q begins at a multiple
// of 3, so that a shader reads a colour at once; the numbers left out before it are zero.
struct Layout {
  struct Tables {
    size_t p_first = 0, p_nodes = 0;  // no nodes for kNone
    size_t q_first = 0, q_nodes = 0;
  };
  std::array<Tables, kMaxStages> stages;
  size_t size = 0;  // numbers a texel
};
int NodesOf(Axis axis, const btf::BtfHeader& header);
Layout LayoutOf(const std::vector<Stage>& stages, const btf::BtfHeader& header);

// The nodes around a parameter; weights are not negative and sum to 1.
struct Taps {
  size_t count = 1;
  std::array<uint16_t, 4> node{};
  std::array<float, 4> weight{1, 0, 0, 0};
};
// Place on the grid of a unit vector of the upper hemisphere (below: its rim), in [0, kGrid - 1].
std::array<float, 2> GridPlace(Vec3 d);
Vec3 HalfVector(Vec3 v, Vec3 l);  // +z where l = -v
Vec3 Difference(Vec3 v, Vec3 l);
struct PairTaps {
  std::array<Taps, kMaxStages> p, q;
};
PairTaps TapsOf(const std::vector<Stage>& stages, const btf::BtfHeader& header, int view, int light);

// Where each stage's tables are: numbers in the order of Layout, of which the stage reads its own.
using TableRows = std::array<const float*, kMaxStages>;
// The product of all stages, each times its scale.
std::array<float, 3> ProductOf(const std::vector<Stage>& stages, const Layout& layout,
                               const PairTaps& taps, const TableRows& rows, const float* scales);
// One stage's sum.
std::array<float, 3> StageSum(const Stage& stage, const Layout::Tables& tables, const Taps& p,
                              const Taps& q, const float* texel);

}  // namespace mesorig::codecs::per_texel
