#pragma once
// The interlock chain: e-stop and door, two normally closed lines, read by level. A line that
// cannot be read is open. While armed (a plan runs) an opening is latched and raises the StopFlag:
// that the chain closes again a moment later does not bring the plan back. Edges only make it
// quicker; Check reads levels. What may be energised again, and when, is Safety's (safety.h), which
// owns the chain and sees all that it sees.

#include <cstdint>
#include <functional>
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
    bool readable = false;             // both; a line that is not is open
    RigTime read_at{};
  };
  // Under the clock's lock (inside Change), after each Check and edge: what the lines say, and
  // whether reset was pressed just now.
  using Watcher = std::function<void(const Levels& levels, bool reset_edge)>;

  // `lines` may be null: a rig whose chain cannot be read has an open one. A rig without interlock
  // (Lines::interlock) has one that is always closed.
  InterlockChain(RigClock& clock, DigitalLines* lines, const Lines& numbers, StopFlag& stop,
                 Watcher watcher = nullptr);
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

  void Arm();  // forgets what was latched
  void Disarm();
  // OK, or FailedPrecondition with the first opening since Arm.
  Status Opening() const;
  // Something else than the chain forbids to go on: as an opening.
  void TripInsideChange(std::string why) { LatchInsideChange(std::move(why)); }

 private:
  void NoteVisitInsideChange(int line, bool level);
  void NoteEdgeInsideChange(int line, bool level, RigTime when);
  Status ReadLine(int line, std::string_view line_name, Levels& levels, bool& closed);
  void LatchInsideChange(std::string opening);

  RigClock& clock_;
  DigitalLines* const lines_;
  const Lines numbers_;
  StopFlag& stop_;
  const Watcher watcher_;
  // Guarded by the clock's lock:
  bool armed_ = false;
  std::string opening_;  // empty: none
  Levels levels_;
  Visit visit_;
  bool door_opened_ = false;  // since BeginVisit
  uint64_t edges_ = 0;         // so far, of any line
  Levels now_;                 // of the last Check or edge
};

}  // namespace mesorig::daemon
