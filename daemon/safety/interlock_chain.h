#pragma once
// The interlock chain: e-stop and door, two normally closed lines, read by level. A line that
// cannot be read is open. While armed (a plan runs) an opening is latched and raises the StopFlag:
// that the chain closes again a moment later does not bring the plan back. Edges only make it
// quicker; Check reads levels.

#include <string>

#include "daemon/device/digital_lines.h"
#include "daemon/device/stop_flag.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// Thread-safe. Borrows everything; takes the lines' one edge listener.
class InterlockChain {
 public:
  struct Levels {
    bool estop = false, door = false;  // true: closed
    RigTime read_at{};
  };

  // `lines` may be null: a rig whose chain cannot be read has an open one.
  InterlockChain(RigClock& clock, DigitalLines* lines, const Lines& numbers, StopFlag& stop);
  ~InterlockChain();

  // Reads both levels now. FailedPrecondition names the line that is open or why it cannot be read;
  // while armed that is latched as an opening.
  Status Check();
  Levels levels() const;  // of the last Check

  // What the operator did at the rig since BeginVisit: the door opened and closed again, then reset
  // pressed with the whole chain closed. Nothing else lets a plan go on after hands were in the
  // rig.
  struct Visit {
    bool door_cycled = false, reset = false;
  };
  void BeginVisit();
  Visit VisitInsideChange() const { return visit_; }

  // A pause begins: from now on an opening asks for reset at the rig, pressed with the chain
  // closed.
  void BeginPause();
  // Reads the chain. FailedPrecondition while it is open, and when it was since BeginPause and
  // reset was not pressed after it closed.
  Status MayGoOn();

  void Arm();  // forgets what was latched, and the pause
  void Disarm();
  // OK, or FailedPrecondition with the first opening since Arm.
  Status Opening() const;

 private:
  void NoteVisitInsideChange(int line, bool level);
  void NotePauseInsideChange(int line, bool level);
  Status ReadLine(int line, std::string_view line_name, bool& closed);
  void LatchInsideChange(std::string opening);

  RigClock& clock_;
  DigitalLines* const lines_;
  const Lines numbers_;
  StopFlag& stop_;
  // Guarded by the clock's lock:
  bool armed_ = false;
  std::string opening_;  // empty: none
  Levels levels_;
  Visit visit_;
  bool door_opened_ = false;  // since BeginVisit
  bool paused_ = false, needs_reset_ = false;
  bool estop_closed_ = true, door_closed_ = true;  // in a pause, by edges and Check
};

}  // namespace mesorig::daemon
