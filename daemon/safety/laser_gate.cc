#include "daemon/safety/laser_gate.h"

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kPoll = std::chrono::milliseconds(10);
constexpr double kLevelMargin_s = 0.1;

}  // namespace

LaserGate::LaserGate(RigClock& clock, DigitalLines* lines, const Lines& numbers, StopFlag& stop,
                     std::function<Status()> permit)
    : clock_(clock),
      lines_(lines),
      numbers_(numbers),
      stop_(stop),
      permit_(std::move(permit)),
      thread_(clock, "laser gate", [this] { Loop(); }) {}

LaserGate::~LaserGate() {
  clock_.Change([&] {
    open_ = false;
    ending_ = true;
  });
}

// An edge that is due at the instant at which the gate is shut is still given: which of the two
// threads runs first at one instant must not matter (docs/lockstep.md).
void LaserGate::Loop() {
  RigTime due = kNever;  // of the next edge
  for (;;) {
    clock_.WaitUntil(due, [&] { return ending_ || open_ != (due != kNever); });
    const RigTime now = clock_.Now();
    const Status permitted = permit_ ? permit_() : OkStatus();
    bool pet = false, hung = false, late = false, ending = false;
    clock_.Change([&] {
      ending = ending_;
      hung = open_ && now - progress_ > FromSeconds(kProgressLimit_s);
      late = open_ && now > until_;
      if (hung || late || !permitted.ok() || stop_.RaisedInsideChange()) open_ = false;
      pet = (open_ && (due == kNever || now >= due)) || (shut_at_ == due && now == due);
      due = !open_ ? kNever : pet ? now + FromSeconds(kPetPeriod_s) : due;
    });
    if (ending) return;
    if (hung) Log("safety").error("laser gate: no progress for {} s: no more edges", kProgressLimit_s);
    if (late) Log("safety").error("laser gate: open beyond the end of its sweep: no more edges");
    if (!pet || !permitted.ok()) continue;
    Status status = lines_->Write(numbers_.laser_trigger, true);
    if (status.ok()) status = lines_->Write(numbers_.laser_trigger, false);
    if (status.ok()) continue;
    Log("safety").error("laser gate: {}", Message(status));
    Shut();
  }
}

StatusOr<bool> LaserGate::Shines() const {
  if (lines_ == nullptr || numbers_.laser_on < 0) {
    return FailedPrecondition("laser gate: the rig has no line that tells whether the laser is on");
  }
  return lines_->Read(numbers_.laser_on);
}

Status LaserGate::AwaitLevel(bool on) {
  const RigTime deadline = clock_.Now() + FromSeconds(kLaserOneShot_s + kLevelMargin_s);
  for (;;) {
    clock_.SleepFor(kPoll);  // first: the edge of this instant may not be given yet
    MESORIG_ASSIGN_OR_RETURN(const bool shines, Shines());
    if (shines == on) return OkStatus();
    if (clock_.Now() >= deadline) {
      return Unavailable("laser gate: line {} says {} after {} s, {} wanted", numbers_.laser_on,
                         shines ? "on" : "off", kLaserOneShot_s + kLevelMargin_s,
                         on ? "on" : "off");
    }
  }
}

Status LaserGate::Open(RigTime until) {
  MESORIG_RETURN_IF_ERROR(Shines().status());
  MESORIG_RETURN_IF_ERROR(stop_.Check());
  if (permit_) MESORIG_RETURN_IF_ERROR(Annotate(permit_(), "laser gate"));
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    open_ = true;
    until_ = until;
    progress_ = now;
  });
  return AwaitLevel(true);
}

bool LaserGate::open() const {
  bool open = false;
  clock_.Read([&] { open = open_; });
  return open;
}

void LaserGate::Progress() {
  const RigTime now = clock_.Now();
  clock_.Change([&] { progress_ = now; });
}

Status LaserGate::Close() {
  Shut();
  return AwaitLevel(false);
}

void LaserGate::Shut() {
  const RigTime now = clock_.Now();
  clock_.Change([&] {
    if (open_) shut_at_ = now;
    open_ = false;
  });
}

}  // namespace mesorig::daemon
