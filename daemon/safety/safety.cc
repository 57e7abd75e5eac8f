#include "daemon/safety/safety.h"

#include <algorithm>
#include <utility>

#include "daemon/safety/guards.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr double kLightStuck_s = 1;  // and twice the lamps' settling time: then it must be dark

// As the rig's own latch tells.
bool ResetWasPressed(const Lines& numbers, DigitalLines* lines) {
  if (!numbers.interlock) return true;
  if (lines == nullptr || numbers.power < 0) return false;
  return lines->Read(numbers.power).value_or(false);
}

double MaxSettle_s(const Rig& rig) {
  double settle_s = 0;
  for (const Lamp& lamp : rig.lamps) settle_s = std::max(settle_s, lamp.settle_s);
  return settle_s;
}

RigTime AliveLimit(const Rig& rig) {
  double longest_s = MaxSettle_s(rig);
  for (const auto& axis : rig.axes) longest_s = std::max(longest_s, axis.settle_s);
  for (const auto& camera : rig.cameras) longest_s = std::max(longest_s, camera.max_exposure_s);
  return FromSeconds(Safety::kAlive_s + longest_s);
}

}  // namespace

Safety::Safety(RigClock& clock, const Rig& rig, SafetyDevices devices, StopFlag& stop,
               SafetyOptions options)
    : clock_(clock),
      rig_(rig),
      devices_(std::move(devices)),
      stop_(stop),
      options_(options),
      alive_limit_(AliveLimit(rig)),
      hours_(rig),
      torque_asked_(devices_.axes.size()),
      chain_(clock, devices_.lines, rig.lines, stop,
             [this](const InterlockChain::Levels& levels, bool reset_edge) {
               seen_.chain = levels;
               if (reset_edge) {  // the contactor needs its time to close
                 power_lost_.Forget();
                 flags_.power_lost = false;
               }
               StepInsideChange(reset_edge, false);
             }),
      stop_round_(std::chrono::steady_clock::now()) {
  // The chain hears every edge from here on: whoever presses reset while this starts is seen either
  // by the edge or by what the contactor says after it.
  (void)chain_.Check();
  if (ResetWasPressed(rig.lines, devices_.lines)) {
    clock.Change([&] { logic_.TakeTheRigsWord(); });
  }
  clock.Read([&] {
    for (int i = kTripCauses - 1; i >= 0; --i) {
      const auto cause = static_cast<TripCause>(i);
      if (logic_.Has(cause)) seen_.reason = CauseInsideChange(cause);
    }
  });
  seen_.has_power_line = rig.lines.power >= 0;
  // What an earlier daemon left on has its own time to go off.
  alive_until_ = clock.Now();
  dark_at_ = alive_until_ + FromSeconds(kLightStuck_s + 2 * MaxSettle_s(rig));
  for (size_t i = 0; i < devices_.axes.size(); ++i) {
    axis_guards_.push_back(std::make_unique<AxisGuard>(*this, *devices_.axes[i], i));
    guarded_axes_.push_back(axis_guards_.back().get());
  }
  guarded_lamps_ = std::make_unique<LampGuard>(*this, *devices_.lamps, rig);
  if (rig.laser) {
    gate_ = std::make_unique<LaserGate>(clock, devices_.lines, rig.lines, stop,
                                        [this] { return MayShine(); });
  }
  stop_thread_ = std::thread([this] { ServeStops(); });
  watch_ = std::make_unique<RigThread>(clock, "safety", [this] { Watch(); });
  PollNow();
}

Safety::~Safety() {
  {
    const std::lock_guard lock(stop_mutex_);
    stop_ending_ = true;
    stop_wake_.notify_all();
  }
  stop_thread_.join();
  clock_.Change([&] { ending_ = true; });
  watch_.reset();
}

bool Safety::EnergisedInsideChange() const {
  const bool asked = lamp_asked_ >= 0 || (gate_ != nullptr && gate_->OpenInsideChange()) ||
                     std::find(torque_asked_.begin(), torque_asked_.end(), true) !=
                         torque_asked_.end();
  const bool read_back = seen_.laser_on || flags_.light_stuck ||
                         std::any_of(seen_.axes.begin(), seen_.axes.end(),
                                     [](const AxisReading& axis) { return axis.torque; });
  return asked || read_back;
}

void Safety::StepInsideChange(bool reset_edge, bool console_reset) {
  SafetyInputs in = flags_;
  in.readable = seen_.chain.readable;
  in.estop = seen_.chain.estop;
  in.door = seen_.chain.door;
  in.reset_edge = reset_edge;
  in.console_reset = console_reset;
  in.energised = EnergisedInsideChange();
  in.hung = in.energised && (flags_.hung || hangs_);
  in.moving = std::any_of(seen_.axes.begin(), seen_.axes.end(),
                          [](const AxisReading& axis) { return axis.moving; });
  const uint16_t before = logic_.latched();
  const bool off_before = outputs_.de_energise;
  outputs_ = logic_.Step(in);
  seen_.energised = in.energised;
  if (outputs_.de_energise && !off_before) act_ = true;
  for (int i = 0; i < kTripCauses; ++i) {
    const auto cause = static_cast<TripCause>(i);
    if ((before & Bit(cause)) != 0 || !logic_.Has(cause)) continue;
    const std::string text = CauseInsideChange(cause);
    if (before == 0 && !seen_.tripped) {
      seen_.reason = text;
      seen_.tripped_at = seen_.chain.read_at;
      ++seen_.trips;
      untold_.push_back(text);
      act_ = true;
    }
    seen_.tripped = true;
    // Of the chain's own openings it has said so itself, with the line and when.
    if (cause > TripCause::kDoor && cause != TripCause::kUnreadable) chain_.TripInsideChange(text);
  }
  seen_.tripped = logic_.latched() != 0;
  if (!seen_.tripped) seen_.reason.clear();
}

std::string Safety::CauseInsideChange(TripCause cause) const {
  if (cause == TripCause::kLight && !light_.empty()) return fmt::format("safety: {}", light_);
  if (cause == TripCause::kHot && !heat_.empty()) return fmt::format("safety: {}", heat_);
  if (cause == TripCause::kHung && !hang_.empty()) return fmt::format("safety: {}", hang_);
  if (cause == TripCause::kPower) {
    return fmt::format("interlock chain: the contactor (line {}) is open though the chain reads closed",
                       rig_.lines.power);
  }
  return fmt::format("safety: {}", Text(cause));
}

Status Safety::PermitInsideChange() const {
  if (outputs_.may_energise) return OkStatus();
  if (logic_.latched() == 0) {
    return FailedPrecondition("interlock chain: {} is open",
                              !seen_.chain.readable ? "a line that cannot be read"
                              : !seen_.chain.estop  ? "emergency stop"
                                                    : "door");
  }
  std::string causes;
  for (int i = 0; i < kTripCauses; ++i) {
    const auto cause = static_cast<TripCause>(i);
    if (!logic_.Has(cause)) continue;
    causes += fmt::format("{}{}", causes.empty() ? "" : ", ", Text(cause));
  }
  if (logic_.needs_the_rig()) {
    return FailedPrecondition("safety: {}; with the chain closed, press reset (line {}) at the rig",
                              causes, rig_.lines.reset);
  }
  return FailedPrecondition("safety: {} ({}); when that is gone, reset or the next start clears it",
                            causes, seen_.reason);
}

Status Safety::Permit() const {
  Status status;
  clock_.Read([&] { status = PermitInsideChange(); });
  return status;
}

Status Safety::MayEnergise() {
  MESORIG_RETURN_IF_ERROR(chain_.Check());
  return Permit();
}

Status Safety::MayAsk() const {
  Status status;
  clock_.Read([&] {
    status = stopping_ > 0 ? Cancelled("somebody said stop") : PermitInsideChange();
  });
  return status;
}

Status Safety::Reset() {
  PollNow();
  clock_.Change([&] { StepInsideChange(false, true); });
  return MayEnergise();
}

void Safety::AliveUntil(RigTime until) {
  clock_.Change([&] { alive_until_ = until; });
}

void Safety::AskTorque(size_t axis, bool on) {
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    torque_asked_[axis] = on;
    alive_until_ = std::max(alive_until_, now);
    if (!on) {
      motion_stuck_.Forget();
      flags_.motion_stuck = false;
    }
    StepInsideChange(false, false);
  });
}

void Safety::AskLight(int lamp) {
  const RigTime now = clock_.Now();
  hours_.Burn(lamp, now);
  clock_.Change([&] {
    if (lamp != lamp_asked_) {
      dark_at_ = now + FromSeconds(kLightStuck_s + 2 * MaxSettle_s(rig_));
      flags_.light_stuck = dark_seen_ = false;
    }
    lamp_asked_ = lamp;
    off_owed_ = false;
    alive_until_ = std::max(alive_until_, now);
    StepInsideChange(false, false);
  });
}

void Safety::OweDarkness() {
  clock_.Change([&] { off_owed_ = true; });
}

Status Safety::MayMove() {
  if (gate_ == nullptr) return OkStatus();
  if (gate_->open()) return FailedPrecondition("the laser's gate is open: nothing moves meanwhile");
  const auto shines = gate_->Shines();
  if (!shines.ok()) return FailedPrecondition("nothing moves: {}", Message(shines.status()));
  return *shines ? FailedPrecondition("the laser shines: nothing moves meanwhile") : OkStatus();
}

Status Safety::MayShine() {
  MESORIG_RETURN_IF_ERROR(MayAsk());
  for (const Axis* axis : devices_.axes) {
    if (axis->Read().moving) return FailedPrecondition("axis {} moves: no laser", axis->name());
  }
  return OkStatus();
}

SafetyState Safety::state() const {
  SafetyState state;
  const RigTime now = clock_.Now();
  clock_.Read([&] {
    state = seen_;
    const Status permit = PermitInsideChange();
    state.may_energise = permit.ok();
    state.why_not = Message(permit);
    state.causes = logic_.latched();
    state.needs_reset_at_rig = logic_.needs_the_rig();
  });
  state.lamp_hours = hours_.Hours(now);
  return state;
}

Status Safety::KeepLampHours(const std::filesystem::path& file) {
  MESORIG_RETURN_IF_ERROR(hours_.Keep(file));
  for (const std::string& text : hours_.Overdue(clock_.Now())) Log("safety").warn("{}", text);
  return OkStatus();
}

}  // namespace mesorig::daemon
