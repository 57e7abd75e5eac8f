#pragma once
// How the rig stands, and how it gets there: axes and lamps (docs/running.md, "One shot after the
// other"). Begin sets out and returns, so that cameras can read out meanwhile; Reach waits.

#include <optional>
#include <vector>

#include "daemon/control/run_context.h"

namespace mesorig::daemon {

// What a plan's moves and lamps ask for.
struct Stance {
  std::vector<double> axis_rad;  // one per Rig::axes; empty: wherever they are
  double settle_s = 0;           // at rest after the last axis arrived
  int lamp = -1;                 // index into Rig::lamps that shines alone; -1: none
};

// Of one run, on the sequencer's thread.
class RigStance {
 public:
  explicit RigStance(const RunContext& context);  // borrowed

  // Nothing is known any more: after power came on, or went.
  void Forget();
  // Starts what is not there or on its way, all in one instant. Errors of the devices.
  Status Begin(const Stance& wanted);
  // Begins, and blocks until all axes are there and at rest and the light is steady: by two
  // readings in a row, and never before the rig's settling time. DeadlineExceeded, Unavailable:
  // the axis or lamp is named; Cancelled: the StopFlag is up.
  Status Reach(const Stance& wanted);

  // Unavailable when an axis does not stand where it was moved to.
  Status CheckHolds() const;
  std::vector<double> ReadAxes();  // also to the board
  StatusOr<std::vector<double>> ReadLevels();
  // Unavailable when the lamp that should shine has lost light since it was steady.
  Status CheckLit(const std::vector<double>& levels) const;

 private:
  Status SwitchLamp(int lamp);
  Status StartAxes(const std::vector<double>& axis_rad);
  Status AwaitAxes();
  Status AwaitLight();
  bool Steady(const std::vector<double>& levels) const;
  Status Wait(RigTime until) const;

  const RunContext& context_;
  struct AxisState {
    std::optional<double> target_rad;  // commanded last; none: unknown
    bool moving = false;
    RigTime deadline{};
  };
  std::vector<AxisState> axes_;
  RigTime arrived_{};        // the last axis
  RigTime rested_{};         // each axis that moved, by what it needs itself
  std::optional<int> lamp_;  // commanded last; none: unknown
  RigTime switched_{};
  bool steady_ = false;
};

}  // namespace mesorig::daemon
