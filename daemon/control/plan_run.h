#pragma once
// One way through a plan's steps on the devices, from torque on to torque off: takes what the
// session is missing, and nothing else. Runs again after a pause or a failure until nothing is
// missing. On the sequencer's thread, inside an activity of the rig clock.

#include <optional>
#include <vector>

#include "daemon/control/camera_array.h"
#include "daemon/control/rig_power.h"
#include "daemon/control/rig_stance.h"
#include "daemon/control/run_context.h"
#include "daemon/control/shot_book.h"
#include "daemon/control/sweeps.h"

namespace mesorig::daemon {

// What a resumed session proves before it goes on.
struct ReferenceCheck {
  bool wanted = false;
  bool accept_any = false;  // the operator has seen the difference and goes on regardless
};

// How a way through the plan ended.
enum class RunEnd {
  kDone,     // nothing is missing, everything is off
  kPause,    // at a safe step, as ordered
  kStorage,  // at a safe step: the disk takes nothing
  kFailed,   // a device failed, or a command cut it short; what it needs is on somebody else
  kRefused,  // going on is not permitted: the reference frame is another one, or the plan is wrong
  kSession,  // the session takes nothing any more
};

struct RunResult {
  RunEnd end = RunEnd::kDone;
  Status status;  // not OK unless done or paused; Cancelled: the StopFlag is up
};

// Borrows the context.
class PlanRun {
 public:
  PlanRun(const RunContext& context, ReferenceCheck reference);

  // Unless it ends with kDone the caller calls MakeSafe.
  RunResult Go();
  Status MakeSafe() { return power_.MakeSafe(); }
  // A device failed: that it is back is journaled once everything is up again.
  void ExpectRecovery(std::string failure) { failure_ = std::move(failure); }
  Status Park() { return power_.Park(); }
  const RunProgress& progress() const { return book_.progress(); }
  ShotBook& book() { return book_; }
  // Rig time that opening, homing and the reference took, all of it.
  double preparation_s() const { return preparation_s_; }

 private:
  // The plan's wanted state, folded from its steps up to one of them.
  struct Place {
    Stance stance;
    int mount = -1;                // the laser's; -1: none
    const Step* prompt = nullptr;  // the last one passed
  };
  static void Fold(const Step& step, Place& place);
  bool NeedsVisit(const Step& step, const Place& place) const;
  bool Wants(const Step& step) const;  // frames, or an exposure, are missing

  Status Walk();
  Status TakeStep(size_t index, const Place& place);
  Status Prepare();
  Status CheckReference();
  Status ShootReference(const Step& step, const Place& place, const StoredFrame& reference);
  Status SafeStep();
  Status Visit(const Step& step, const Place& place);
  StatusOr<double> ExposureOf(const Step& step) const;
  Status TakeShot(size_t index, const Place& place);
  Status ShootOnce(size_t index, const Place& place, double exposure_s, std::vector<int>& cameras,
                   Status& missing);
  Status ApproachNext(size_t index, Place place);
  Status AllPasses();
  // When nothing is missing: to rest, and what the plan asks for after its last frame.
  Status Close(bool up);
  bool DiskTakesNothing(const Status& status) const;

  const RunContext& context_;
  RigStance stance_;
  CameraArray cameras_;
  RigPower power_;
  ShotBook book_;
  Sweeps sweeps_;
  ReferenceCheck reference_;
  std::string failure_;  // that is to be recovered from
  bool homed_all_ = false;
  int mount_ = -1;                  // where the operator put the laser in this run
  const Step* answered_ = nullptr;  // the prompt whose request the rig stands in
  std::optional<RunEnd> end_;       // why a walk ended, when it is not a device
  double preparation_s_ = 0;
};

}  // namespace mesorig::daemon
