#pragma once
// The line laser: where it is mounted, where its emitter points and whether it shines. Called by
// the dispatcher only.

#include <deque>
#include <functional>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"
#include "simulator/devices/contactor.h"
#include "simulator/plant/geared_motor.h"

namespace mesorig::simulator {

class LaserUnit {
 public:
  // The rig must have a laser; rig and contactor are borrowed. It hangs at the first mount.
  LaserUnit(const Rig& rig, uint64_t seed, Contactor& contactor);

  // The gate. A rising edge holds it open for kLaserOneShot_s; without supply (contactor, brick) an
  // edge does nothing, and a supply that comes back finds the gate shut.
  void Trigger(RigTime now);
  void SetBrickOn(bool on, RigTime now);
  // The one-shot's end: shut at or after it. kNever while it does not shine.
  RigTime GateEnd() const { return shines_ ? gate_end_ : kNever; }
  void ExpireGate(RigTime now);
  bool Shines(RigTime now) const { return shines_ && now < gate_end_; }
  RigTime last_change() const { return switches_.empty() ? RigTime{} : switches_.back().first; }
  double MeanLevel(RigTime from, RigTime to) const;  // share of an exposure, 0..1

  // The operator hangs it at a mount and lines the stripe up with the turntable's centre by eye:
  // the tilt then is one within kMisset_rad that the seed and the mount choose. NotFound for a
  // mount that the rig has not, FailedPrecondition while the contactor is closed: nobody reaches in
  // there.
  Status Mount(std::string_view name, RigTime now);
  int mount() const { return mount_; }

  plant::GearedMotor& motor() { return motor_; }
  const plant::GearedMotor& motor() const { return motor_; }
  double Tilt(RigTime t) const;  // of the emitter, rad

  // Told of each change, after it.
  void OnShine(std::function<void(bool shines, RigTime)> f) { on_shine_ = std::move(f); }
  void OnMount(std::function<void(int mount, RigTime)> f) { on_mount_ = std::move(f); }

  static constexpr double kMisset_rad = 0.15 * kPi / 180;

 private:
  void SetShines(bool shines, RigTime now);
  void Hang(int mount, RigTime now);

  const Laser& laser_;
  const uint64_t seed_;
  bool contactor_closed_ = true, brick_on_ = true;
  bool shines_ = false;
  RigTime gate_end_{};
  std::deque<std::pair<RigTime, bool>> switches_;  // the last ones
  int mount_ = 0;
  double tilt_offset_rad_ = 0;  // tilt = driven side / gear ratio + this
  plant::GearedMotor motor_;
  std::function<void(bool, RigTime)> on_shine_;
  std::function<void(int, RigTime)> on_mount_;
};

}  // namespace mesorig::simulator
