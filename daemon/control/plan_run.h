#pragma once
// One run of one plan: rig ready, steps, rig at rest. Sweeps and prompts are in plan_run_laser.cc.
// On the sequencer's thread, inside an activity of the rig clock.

#include <functional>
#include <vector>

#include "daemon/control/operator_desk.h"
#include "daemon/control/reading_board.h"
#include "daemon/control/sequencer.h"
#include "daemon/safety/interlock_chain.h"
#include "daemon/safety/laser_gate.h"

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
    LaserGate* gate;  // null in a rig without a laser
    OperatorDesk& desk;
    RigClock::Activity& activity;  // of this run: suspended while the operator is asked
    ReadingBoard& board;
    std::function<void(const RunProgress&)> on_progress;  // after each shot
    std::function<void(std::string)> on_note;
    std::function<void(bool waiting)> on_wait;  // for the operator; and again when that is over
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
  Status Mount(int mount);
  Status AskForMount(int mount);
  Status RunSweep(const Step& step);
  Status WindDown();

  // Sets exposure and region of those cameras that have other ones.
  Status ConfigureCameras(const Step& step);
  // What a sweep owes: per frame the cameras whose picture is still missing.
  using Owed = std::vector<std::vector<int>>;
  Status SweepOnce(const Step& step, Owed& owed, Status& missing);
  Status ShootSweepFrames(const Step& step, double rate_rad_s, Owed& owed, Status& missing);
  Status ShootSweepFrame(const Step& step, uint32_t index, RigTime deadline,
                         std::vector<int>& cameras, Status& missing);
  // One trigger of `cameras` in one instant; appends what came and leaves in `cameras` who owes a
  // frame.
  Status ShootOnce(const Step& step, std::vector<int>& cameras, Status& missing);
  Status TriggerAll(const std::vector<int>& cameras);
  // The frames of the last trigger, appended to the session; `cameras` are left with those whose
  // frame did not come, `missing` says why.
  using RecordMaker = std::function<FrameRecord(int camera, const CapturedFrame& frame)>;
  Status CollectFrames(RigTime deadline, std::vector<int>& cameras, Status& missing,
                       const RecordMaker& make_record);
  StatusOr<std::vector<double>> ReadLevels();
  bool Steady(const std::vector<double>& levels) const;
  std::vector<double> ReadAxes();
  FrameRecord MakeRecord(const Step& step, int camera, const CapturedFrame& frame) const;
  bool LaserReady() const { return context_.devices.laser != nullptr && context_.gate != nullptr; }

  const Context& context_;
  const CompiledPlan& plan_;
  Session& session_;
  RunProgress progress_;
  int lamp_ = -1;  // index into Rig::lamps that should shine
  uint32_t last_trigger_ = 0;
  struct CameraSetting {
    double exposure_s = 0;  // 0: not configured
    Region region;
    friend bool operator==(const CameraSetting&, const CameraSetting&) = default;
  };
  std::vector<CameraSetting> camera_settings_;
  int mount_ = -1;                             // where the operator put the laser in this run
  std::vector<double> axis_rad_, lamp_level_;  // read back for the shot under way
};

}  // namespace mesorig::daemon
