#include "processing/btf/pair_weights.h"

#include <limits>

namespace mesorig::btf {

StatusOr<PairInterpolator> PairInterpolator::Build(const BtfHeader& header,
                                                   std::vector<uint8_t> present) {
  MESORIG_RETURN_IF_ERROR(CheckHeader(header));
  if (present.size() != header.views.size() * header.lights.size()) {
    return InvalidArgument("presence of {} pairs for {} views x {} lights", present.size(),
                           header.views.size(), header.lights.size());
  }
  MESORIG_ASSIGN_OR_RETURN(DirectionInterpolator views, DirectionInterpolator::Build(header.views));
  MESORIG_ASSIGN_OR_RETURN(DirectionInterpolator lights,
                           DirectionInterpolator::Build(header.lights));
  return PairInterpolator(std::move(views), std::move(lights), header.cosine_included,
                          std::move(present));
}

bool PairInterpolator::Nearest(Vec3 v, Vec3 l, PairWeights& pairs) const {
  const size_t lights = lights_.directions().size();
  double best = -std::numeric_limits<double>::infinity();
  v = Normalized(v);
  l = Normalized(l);
  for (size_t i = 0; i < present_.size(); ++i) {
    if (present_[i] == 0) continue;
    const double near = Dot(views_.directions()[i / lights], v) +
                        Dot(lights_.directions()[i % lights], l);
    if (near > best) {
      best = near;
      pairs.count = 1;
      pairs.view[0] = static_cast<int>(i / lights);
      pairs.light[0] = static_cast<int>(i % lights);
      pairs.weight[0] = 1;
    }
  }
  return pairs.count != 0;
}

bool PairInterpolator::LookupSeparate(Vec3 v, Vec3 l, SeparateWeights& weights) const {
  bool inside = false;
  weights.view = views_.Lookup(v);
  weights.light = lights_.Lookup(l, inside);
  weights.scale = l.z > 0 ? 1.0f : 0.0f;
  // Inside the weighted direction is l itself.
  if (cosine_included_ && !inside) {
    weights.scale = static_cast<float>(HorizonScale(lights_, weights.light, l));
  }
  if (complete_) return true;
  for (size_t i = 0; i < 9; ++i) {
    const size_t at = static_cast<size_t>(weights.view.index[i / 3]) * lights_.directions().size() +
                      static_cast<size_t>(weights.light.index[i % 3]);
    if (weights.view.weight[i / 3] * weights.light.weight[i % 3] > 0 && present_[at] == 0) return false;
  }
  return true;
}

PairWeights PairInterpolator::Lookup(Vec3 v, Vec3 l) const {
  const DirectionWeights of_view = views_.Lookup(v), of_light = lights_.Lookup(l);
  const size_t lights = lights_.directions().size();
  PairWeights pairs;
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      const float weight = of_view.weight[i] * of_light.weight[j];
      const auto at = static_cast<size_t>(of_view.index[i]) * lights +
                      static_cast<size_t>(of_light.index[j]);
      if (weight <= 0 || present_[at] == 0) continue;
      const auto n = static_cast<size_t>(pairs.count++);
      pairs.view[n] = of_view.index[i];
      pairs.light[n] = of_light.index[j];
      pairs.weight[n] = weight;
      sum += weight;
    }
  }
  if (pairs.count != 0) {
    for (float& weight : pairs.weight) weight = static_cast<float>(weight * (1 / sum));
  } else if (!Nearest(v, l, pairs)) {
    return pairs;
  }
  if (!cosine_included_) {
    pairs.scale = l.z > 0 ? 1.0f : 0.0f;
    return pairs;
  }
  // The lights that are left, as three weights at most, may differ from what was asked for.
  DirectionWeights left;
  left.weight = {};
  for (size_t n = 0; n < static_cast<size_t>(pairs.count); ++n) {
    for (size_t j = 0; j < 3; ++j) {
      if (left.weight[j] == 0 || left.index[j] == pairs.light[n]) {
        left.index[j] = pairs.light[n];
        left.weight[j] += pairs.weight[n];
        break;
      }
    }
  }
  pairs.scale = static_cast<float>(HorizonScale(lights_, left, l));
  return pairs;
}

}  // namespace mesorig::btf
