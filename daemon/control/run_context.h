#pragma once
// What the parts of a run share: borrowed, all of it outlives them. On the sequencer's thread.

#include <functional>
#include <string>

#include "daemon/control/operator_desk.h"
#include "daemon/control/reading_board.h"
#include "daemon/control/sequencer.h"
#include "daemon/control/state_machine.h"
#include "daemon/safety/safety.h"
#include "daemon/session/session.h"

namespace mesorig::daemon {

struct RunProgress {
  uint32_t shots_done = 0, frames = 0;  // of this run; shots of an earlier one included
  uint64_t bytes_left = 0;              // pixels of frames that are still to come
};

struct RunContext {
  RigClock& clock;
  const Rig& rig;
  const Devices& devices;
  Safety& safety;
  InterlockChain& chain;  // safety's
  LaserGate* gate;  // null in a rig without a laser
  OperatorDesk& desk;
  RigClock::Activity& activity;  // of this run: suspended while it is paused or waits for hands
  StateMachine& machine;
  ReadingBoard& board;
  const CompiledPlan& plan;
  Session& session;
  std::function<void(const RunProgress&)> on_progress;  // after each shot
  std::function<void(const std::string&)> on_note;      // logged and journaled
  // Nothing is missing: reconciles and ends the session. Unavailable while the disk takes nothing.
  std::function<Status()> finish;
  std::function<void()> on_state;  // the machine moved
  std::function<void(int camera, const std::string&)> on_alarm;
  // The operator is asked (true), or is done. False: a command came first, nobody is asked.
  std::function<bool(bool waiting)> on_wait;

  bool has_laser() const { return devices.laser != nullptr && gate != nullptr; }
  bool sweeps() const { return plan.sweeps > 0 && has_laser(); }
};

}  // namespace mesorig::daemon
