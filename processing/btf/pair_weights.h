#pragma once
// Which measured (view, light) pairs stand for a pair of arbitrary directions, and with what
// weights: at most three views times three lights, absent pairs never among them.

#include <algorithm>
#include <array>
#include <span>

#include "processing/btf/sampled_btf.h"
#include "processing/btf/spherical_interpolation.h"

namespace mesorig::btf {

struct PairWeights {
  int count = 0;                   // entries used; 0 when nothing at all is present
  std::array<int, 9> view{}, light{};
  std::array<float, 9> weight{};   // sum to one, already without the absent pairs
  // Multiplies the weighted value: HorizonScale for a BTF with the cosine inside, else 1 above the
  // horizon; 0 below.
  float scale = 0;
};

// Three views times three lights, where none of those pairs is absent.
struct SeparateWeights {
  DirectionWeights view, light;
  float scale = 0;  // as in PairWeights
};

// Immutable; lookups are reentrant. Copies what it needs.
class PairInterpolator {
 public:
  // `present`: view * lights + light. InvalidArgument as CheckHeader.
  static StatusOr<PairInterpolator> Build(const BtfHeader& header, std::vector<uint8_t> present);
  // Where every pair around (v, l) is absent, the present pair nearest to it has weight 1.
  PairWeights Lookup(Vec3 v, Vec3 l) const;
  // The same as a product, faster; false where a pair around (v, l) is absent.
  bool LookupSeparate(Vec3 v, Vec3 l, SeparateWeights& weights) const;
  const DirectionInterpolator& views() const { return views_; }
  const DirectionInterpolator& lights() const { return lights_; }

 private:
  PairInterpolator(DirectionInterpolator views, DirectionInterpolator lights, bool cosine,
                   std::vector<uint8_t> present)
      : views_(std::move(views)), lights_(std::move(lights)), cosine_included_(cosine),
        present_(std::move(present)),
        complete_(std::find(present_.begin(), present_.end(), 0) == present_.end()) {}
  bool Nearest(Vec3 v, Vec3 l, PairWeights& pairs) const;

  DirectionInterpolator views_, lights_;
  bool cosine_included_;
  std::vector<uint8_t> present_;
  bool complete_;
};

}  // namespace mesorig::btf
