#include "simulator/devices/laser_unit/laser_unit.h"

#include <algorithm>
#include <cmath>

#include "simulator/plant/philox.h"

namespace mesorig::simulator {
namespace {

constexpr uint32_t kMissetStream = 0x4D4F55;  // a stream of its own
constexpr size_t kKeptSwitches = 1024;
constexpr double kDegree = kPi / 180;  // what the tachometer counts, and the motor's detents

}  // namespace

LaserUnit::LaserUnit(const Rig& rig, uint64_t seed, Contactor& contactor)
    : laser_(*rig.laser), seed_(seed), motor_(laser_.backlash_rad, kDegree) {
  Hang(0, {});
  contactor.OnChange([this](bool closed, RigTime now) {
    contactor_closed_ = closed;
    if (!closed) SetShines(false, now);
  });
}

void LaserUnit::Trigger(RigTime now) {
  ExpireGate(now);
  if (!contactor_closed_ || !brick_on_) return;
  gate_end_ = now + FromSeconds(kLaserOneShot_s);
  SetShines(true, now);
}

void LaserUnit::SetBrickOn(bool on, RigTime now) {
  brick_on_ = on;
  if (!on) SetShines(false, now);
}

void LaserUnit::ExpireGate(RigTime now) {
  if (shines_ && now >= gate_end_) SetShines(false, gate_end_);
}

void LaserUnit::SetShines(bool shines, RigTime now) {
  if (shines == shines_) return;
  shines_ = shines;
  switches_.emplace_back(now, shines);
  if (switches_.size() > kKeptSwitches) switches_.pop_front();
  if (on_shine_) on_shine_(shines, now);
}

double LaserUnit::MeanLevel(RigTime from, RigTime to) const {
  if (!(to > from)) return Shines(from) ? 1 : 0;
  RigTime lit{};
  for (size_t i = 0; i < switches_.size(); ++i) {
    if (!switches_[i].second) continue;
    const RigTime end = i + 1 < switches_.size() ? switches_[i + 1].first : gate_end_;
    lit += std::max(RigTime{}, std::min(end, to) - std::max(switches_[i].first, from));
  }
  return Seconds(lit) / Seconds(to - from);
}

Status LaserUnit::Mount(std::string_view name, RigTime now) {
  for (size_t m = 0; m < laser_.mounts.size(); ++m) {
    if (laser_.mounts[m].name != name) continue;
    if (contactor_closed_) {
      return FailedPrecondition("{}: the contactor is closed; open the door first", laser_.name);
    }
    Hang(static_cast<int>(m), now);
    return OkStatus();
  }
  std::string names;
  for (const LaserMount& mount : laser_.mounts) {
    names += (names.empty() ? "" : ", ") + mount.name;
  }
  return NotFound("{} has no mount \"{}\"; it has {}", laser_.name, name, names);
}

void LaserUnit::Hang(int mount, RigTime now) {
  mount_ = mount;
  plant::PhiloxStream random({static_cast<uint32_t>(seed_), static_cast<uint32_t>(seed_ >> 32)},
                             kMissetStream, static_cast<uint32_t>(mount), 0);
  const double misset = (2 * random.Uniform() - 1) * kMisset_rad;
  // The hand leaves the motor on a whole degree: what follows does not depend on what was before.
  motor_.Place(std::round(motor_.Angle(now) / kDegree) * kDegree, now);
  tilt_offset_rad_ = misset - motor_.Driven(now) / laser_.gear_ratio;
  if (on_mount_) on_mount_(mount, now);
}

double LaserUnit::Tilt(RigTime t) const {
  return motor_.Driven(t) / laser_.gear_ratio + tilt_offset_rad_;
}

}  // namespace mesorig::simulator
