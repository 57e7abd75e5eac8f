#pragma once
// One run of one plan: rig ready, steps, rig at rest. On the sequencer's thread, inside an activity
// of the rig clock.

#include <functional>
#include <vector>

#include "daemon/control/reading_board.h"
#include "daemon/control/sequencer.h"
#include "daemon/safety/interlock_chain.h"

namespace mesorig::daemon {

struct RunProgress {
  uint32_t shots_done = 0, frames = 0;
};

// Borrows everything.
class PlanRun {
 public:
  struct Context {
    RigClock& clock;
    const Rig& rig;
    const Devices& devices;
    InterlockChain& chain;
    ReadingBoard& board;
    std::function<void(const RunProgress&)> on_progress;  // after each shot
    std::function<void(std::string)> on_note;
  };
  PlanRun(const Context& context, const CompiledPlan& plan, Session& session)
      : context_(context), plan_(plan), session_(session) {}

  // Everything from enabling the axes to lamps and torque off. On any error the caller calls
  // MakeSafe. Cancelled: somebody said stop; FailedPrecondition: the chain is open; else the
  // device's error.
  Status Run();
  // Lamps off, axes quick-stopped, then torque off. Goes on after each failure; what failed is
  // logged and noted.
  void MakeSafe();

 private:
  Status Prepare();
  Status HomeAxes();
  Status RunStep(const Step& step);
  Status MoveAxes(const Step& step);
  Status SwitchLamp(int lamp);
  Status Shoot(const Step& step);
  Status WindDown();

  // Sets the exposure of those cameras that have another one.
  Status ConfigureCameras(const Step& step);
  // One trigger of `cameras` in one instant; appends what came and leaves in `cameras` who owes a
  // frame.
  Status ShootOnce(const Step& step, std::vector<int>& cameras, Status& missing);
  StatusOr<std::vector<double>> ReadLevels();
  bool Steady(const std::vector<double>& levels) const;
  std::vector<double> ReadAxes();
  FrameRecord MakeRecord(const Step& step, int camera, const CapturedFrame& frame) const;

  const Context& context_;
  const CompiledPlan& plan_;
  Session& session_;
  RunProgress progress_;
  int lamp_ = -1;  // index into Rig::lamps that should shine
  uint32_t last_trigger_ = 0;
  std::vector<double> exposure_of_camera_;     // 0: not configured
  std::vector<double> axis_rad_, lamp_level_;  // read back for the shot under way
};

}  // namespace mesorig::daemon
