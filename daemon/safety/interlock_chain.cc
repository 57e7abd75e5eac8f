#include "daemon/safety/interlock_chain.h"

namespace mesorig::daemon {
namespace {

constexpr int kReadAttempts = 4;
constexpr std::string_view kEstop = "emergency stop", kDoor = "door";

}  // namespace

InterlockChain::InterlockChain(RigClock& clock, DigitalLines* lines, const Lines& numbers,
                               StopFlag& stop, Watcher watcher)
    : clock_(clock),
      lines_(lines),
      numbers_(numbers),
      stop_(stop),
      watcher_(std::move(watcher)) {
  if (lines_ == nullptr) return;
  lines_->OnEdge(
      [this](int line, bool level, RigTime when) { NoteEdgeInsideChange(line, level, when); });
}

void InterlockChain::NoteEdgeInsideChange(int line, bool level, RigTime when) {
  ++edges_;
  NoteVisitInsideChange(line, level);
  if (line == numbers_.estop) now_.estop = level;
  if (line == numbers_.door) now_.door = level;
  const bool of_chain = line == numbers_.estop || line == numbers_.door;
  if (of_chain && !level) {
    LatchInsideChange(fmt::format("interlock chain: {} (line {}) opened at {:.3f} s",
                                  line == numbers_.estop ? kEstop : kDoor, line, Seconds(when)));
  }
  if (watcher_) watcher_(now_, line == numbers_.reset && level);
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

Status InterlockChain::ReadLine(int line, std::string_view line_name, Levels& levels,
                                bool& closed) {
  closed = !numbers_.interlock;
  if (closed) return OkStatus();
  if (lines_ == nullptr) {
    levels.readable = false;
    return FailedPrecondition("interlock chain: {} (line {}) cannot be read: the rig has no lines",
                              line_name, line);
  }
  const auto level = lines_->Read(line);
  if (!level.ok()) {
    levels.readable = false;
    return FailedPrecondition("interlock chain: {} (line {}) cannot be read, so it is open: {}",
                              line_name, line, Message(level.status()));
  }
  closed = *level;
  if (closed) return OkStatus();
  return FailedPrecondition("interlock chain: {} (line {}) is open", line_name, line);
}

Status InterlockChain::Check() {
  for (int attempt = 1;; ++attempt) {
    Levels levels;
    levels.readable = true;
    uint64_t edges = 0;
    clock_.Read([&] { edges = edges_; });
    const Status estop = ReadLine(numbers_.estop, kEstop, levels, levels.estop);
    const Status door = ReadLine(numbers_.door, kDoor, levels, levels.door);
    levels.read_at = clock_.Now();
    const Status status = estop.ok() ? door : estop;
    bool moved = false;
    clock_.Change([&] {
      // What changed while it was read is newer: an old "open" must not undo a reset.
      moved = edges_ != edges && attempt < kReadAttempts;
      if (moved) return;
      levels_ = now_ = levels;
      if (!status.ok()) LatchInsideChange(std::string(Message(status)));
      if (watcher_) watcher_(now_, false);
    });
    if (!moved) return status;
  }
}

InterlockChain::Levels InterlockChain::levels() const {
  Levels levels;
  clock_.Read([&] { levels = levels_; });
  return levels;
}

void InterlockChain::Arm() {
  clock_.Change([&] {
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
