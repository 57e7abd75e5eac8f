#pragma once
// Runs compiled plans on the rig's devices, one at a time, on a rig thread of its own.

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/control/operator_desk.h"
#include "daemon/control/state_table.h"
#include "daemon/device/axis.h"
#include "daemon/device/camera.h"
#include "daemon/device/digital_lines.h"
#include "daemon/device/lamp_bank.h"
#include "daemon/device/line_laser.h"
#include "daemon/device/stop_flag.h"
#include "daemon/safety/safety.h"
#include "daemon/session/session.h"
#include "protocol/base/clocks.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// All devices of a rig, in the order of the rig's lists. Borrowed by the sequencer, owned by app.
struct Devices {
  std::vector<Axis*> axes;
  LampBank* lamps = nullptr;
  DigitalLines* lines = nullptr;
  LineLaser* laser = nullptr;  // null in a rig without one
  std::vector<Camera*> cameras;
  StopFlag* stop = nullptr;  // the one that the devices' waits look at
};

// What is to be run.
struct SessionJob {
  CompiledPlan plan;
  std::shared_ptr<Session> session;  // shared with those who read it while it grows
  bool resumed = false;              // homes all axes and takes the reference frame first
  bool accept_reference = false;     // whatever the reference frame shows
};

enum class ReadingSource : uint8_t {
  kReadBack,   // the device said so
  kCommanded,  // it was told so
};

// A value of the rig, with when it was read or commanded.
struct Reading {
  std::string name, unit;
  double value = 0;
  RigTime read_at{};
  ReadingSource source = ReadingSource::kReadBack;
};

// Frames that were thrown away or never came, since the sequencer was made.
struct FrameTrouble {
  uint64_t late = 0;     // after their deadline, or of an earlier trigger
  uint64_t lost = 0;     // never came
  uint64_t refused = 0;  // torn, stale, duplicated, of a camera whose clock jumped
};

struct SequencerStatus {
  SequencerState state = SequencerState::kIdle;
  std::string session_id;  // running or last
  uint32_t shots_done = 0, shots = 0, frames = 0, frames_durable = 0;
  uint64_t bytes_left = 0;  // pixels of frames that are still to come
  uint32_t alarms = 0;      // of this run
  double rig_s = 0;         // since the run began, pauses and visits in virtual time excluded
  double estimated_s = 0, remaining_s = 0;
  std::string message;  // why it is where it is
  std::string storage;  // why the disk takes nothing; empty: it does
  std::vector<Reading> readings;
  RigTime now{};
  bool deterministic = true;
  std::optional<OperatorPrompt> prompt;  // in kWaiting
  FrameTrouble trouble;
  uint64_t frames_queued = 0;    // of the run: taken, not durable yet
  uint64_t frames_verified = 0;  // read again at its end
};

// What happened, for clients; sequence numbers are the service's.
struct SequencerEvent {
  enum class Kind { kState, kStarted, kProgress, kPrompt, kEnded, kNote, kAlarm };
  Kind kind = Kind::kNote;
  SequencerStatus status;
  bool complete = false;
  double virtual_s = 0, wall_s = 0;
  double preparation_s = 0;  // of virtual_s: opening, homing, the reference frame
  std::string text;
  std::string camera;    // kAlarm: its name
  bool resumed = false;  // kStarted
};

// Thread contract: every method from any thread; the listener is called on the sequencer's thread,
// or on that of a command, and returns quickly.
class Sequencer {
 public:
  // `deterministic` tells whether virtual time was the simulator's alone so far. `safety`: the
  // rig's, which outlives the sequencer; null: it makes one of these devices for itself.
  static std::unique_ptr<Sequencer> Create(RigClock& clock, const Rig& rig, Devices devices,
                                           std::function<bool()> deterministic,
                                           Safety* safety = nullptr);
  virtual ~Sequencer() = default;
  // What Begin would refuse whatever the session: FailedPrecondition for a state that does not know
  // the command, for an open interlock chain and whatever else Safety forbids, and for a plan with
  // a laser on a rig without interlock; InvalidArgument for a plan of another rig. A start clears
  // of what tripped what a console may clear (Safety::Reset).
  virtual Status CheckBegin(SequencerCommand how, const CompiledPlan& plan) = 0;
  // `how`: kArm, kRun or kResume. Returns at once; refuses as CheckBegin. A session that was
  // refused is the caller's.
  virtual Status Begin(SequencerCommand how, SessionJob job) = 0;
  // `command`: kStart, kPause, kPauseNow, kContinue, kAbort or kReset. Returns when it is ordered,
  // not when it is done (GetStatus tells). FailedPrecondition as the state table says; of kStart
  // and kContinue also when Safety forbids: the chain is open, or was and reset was not pressed.
  // kReset switches the lamps off first: Unavailable when the bank does not answer.
  virtual Status Command(SequencerCommand command, std::string_view reason) = 0;
  // Lamps off and axes quick-stopped, at once; the session ends incomplete. Returns when the lamps
  // are off (Unavailable when the bank does not answer), not when the session has ended. When idle:
  // lamps off.
  virtual Status Stop(std::string_view reason) = 0;
  // The operator has done what the prompt asks for; the plan goes on once the rig says so too.
  // FailedPrecondition when another prompt, or none, is waiting.
  virtual Status Acknowledge(uint32_t prompt_id) = 0;
  virtual SequencerStatus GetStatus() const = 0;
  virtual void OnEvent(std::function<void(const SequencerEvent&)> listener) = 0;
  // The rig's. Null of a sequencer that drives none.
  virtual Safety* safety() { return nullptr; }
};

}  // namespace mesorig::daemon
