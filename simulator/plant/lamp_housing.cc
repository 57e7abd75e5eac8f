#include "simulator/plant/lamp_housing.h"

#include <algorithm>
#include <cmath>

namespace mesorig::plant {

void LampHousing::Set(double level, double now_s) {
  Heat(At(now_s), now_s);
  level_ = level;
}

void LampHousing::Heat(double celsius, double now_s) {
  start_c_ = celsius;
  changed_s_ = now_s;
}

double LampHousing::At(double t_s) const {
  const double end_c = kRoom_c + kRise_c * level_;
  return end_c + (start_c_ - end_c) * std::exp(-std::max(0.0, t_s - changed_s_) / kLag_s);
}

}  // namespace mesorig::plant
