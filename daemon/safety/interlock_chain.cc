#include "daemon/safety/interlock_chain.h"

namespace mesorig::daemon {
namespace {

constexpr std::string_view kEstop = "emergency stop", kDoor = "door";

}  // namespace

InterlockChain::InterlockChain(RigClock& clock, DigitalLines* lines, const Lines& numbers,
                               StopFlag& stop)
    : clock_(clock), lines_(lines), numbers_(numbers), stop_(stop) {
  if (lines_ == nullptr) return;
  lines_->OnEdge([this](int line, bool level, RigTime when) {
    NoteVisitInsideChange(line, level);
    NotePauseInsideChange(line, level);
    const bool of_chain = line == numbers_.estop || line == numbers_.door;
    if (level || !of_chain) return;
    LatchInsideChange(fmt::format("interlock chain: {} (line {}) opened at {:.3f} s",
                                  line == numbers_.estop ? kEstop : kDoor, line, Seconds(when)));
  });
}

InterlockChain::~InterlockChain() {
  if (lines_ != nullptr) lines_->OnEdge([](int, bool, RigTime) {});
}

void InterlockChain::LatchInsideChange(std::string opening) {
  if (!armed_ || !opening_.empty()) return;
  opening_ = std::move(opening);
  stop_.RaiseInsideChange(opening_);
}

void InterlockChain::BeginVisit() {
  clock_.Change([&] {
    visit_ = {};
    door_opened_ = false;
  });
}

void InterlockChain::NoteVisitInsideChange(int line, bool level) {
  if (line == numbers_.door) {
    if (!level) {
      door_opened_ = true;
      visit_ = {};  // hands may be in the rig again
    } else if (door_opened_) {
      visit_.door_cycled = true;
    }
  }
  if (line == numbers_.reset && level && visit_.door_cycled) visit_.reset = true;
}

Status InterlockChain::ReadLine(int line, std::string_view line_name, bool& closed) {
  closed = false;
  if (lines_ == nullptr) {
    return FailedPrecondition("interlock chain: {} (line {}) cannot be read: the rig has no lines",
                              line_name, line);
  }
  const auto level = lines_->Read(line);
  if (!level.ok()) {
    return FailedPrecondition("interlock chain: {} (line {}) cannot be read, so it is open: {}",
                              line_name, line, Message(level.status()));
  }
  closed = *level;
  if (closed) return OkStatus();
  return FailedPrecondition("interlock chain: {} (line {}) is open", line_name, line);
}

Status InterlockChain::Check() {
  Levels levels;
  const Status estop = ReadLine(numbers_.estop, kEstop, levels.estop);
  const Status door = ReadLine(numbers_.door, kDoor, levels.door);
  levels.read_at = clock_.Now();
  const Status status = estop.ok() ? door : estop;
  clock_.Change([&] {
    levels_ = levels;
    estop_closed_ = levels.estop;
    door_closed_ = levels.door;
    needs_reset_ = needs_reset_ || (paused_ && !status.ok());
    if (!status.ok()) LatchInsideChange(std::string(Message(status)));
  });
  return status;
}

InterlockChain::Levels InterlockChain::levels() const {
  Levels levels;
  clock_.Read([&] { levels = levels_; });
  return levels;
}

void InterlockChain::NotePauseInsideChange(int line, bool level) {
  if (line == numbers_.estop) estop_closed_ = level;
  if (line == numbers_.door) door_closed_ = level;
  const bool closed = estop_closed_ && door_closed_;
  if (paused_ && !closed) needs_reset_ = true;
  if (line == numbers_.reset && level && closed) needs_reset_ = false;
}

void InterlockChain::BeginPause() {
  clock_.Change([&] {
    paused_ = true;
    needs_reset_ = false;
  });
  (void)Check();  // one that is open already asks for reset as well
}

Status InterlockChain::MayGoOn() {
  MESORIG_RETURN_IF_ERROR(Check());
  bool needs_reset = false;
  clock_.Read([&] { needs_reset = needs_reset_; });
  if (!needs_reset) return OkStatus();
  return FailedPrecondition(
      "interlock chain: it was opened during the pause; press reset (line {}) at the rig",
      numbers_.reset);
}

void InterlockChain::Arm() {
  clock_.Change([&] {
    paused_ = needs_reset_ = false;
    armed_ = true;
    opening_.clear();
  });
}

void InterlockChain::Disarm() {
  clock_.Change([&] { armed_ = false; });
}

Status InterlockChain::Opening() const {
  Status status;
  clock_.Read([&] {
    if (!opening_.empty()) status = FailedPrecondition("{}", opening_);
  });
  return status;
}

}  // namespace mesorig::daemon
