// Every state x every command x every device failing at its next operation, once and for good: what
// is refused changes nothing, lamps, laser and torque end where the table says, and from wherever
// that is commands lead to idle and a fresh run to its end.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>

#include "tests/daemon/fakes/laser_bench.h"

namespace mesorig::daemon {
namespace {

using Command = SequencerCommand;
using State = SequencerState;

// Where a walk starts: a state, and for running what is under way.
enum class Start {
  kIdle,
  kArmed,
  kInShot,
  kInSweep,
  kPausing,
  kPaused,
  kWaiting,
  kStopping,
  kFault
};
constexpr Start kStarts[] = {Start::kIdle,    Start::kArmed,    Start::kInShot,
                             Start::kInSweep, Start::kPausing,  Start::kPaused,
                             Start::kWaiting, Start::kStopping, Start::kFault};
constexpr State StateOf(Start start) {
  switch (start) {
    case Start::kIdle:
      return State::kIdle;
    case Start::kArmed:
      return State::kArmed;
    case Start::kInShot:
    case Start::kInSweep:
      return State::kRunning;
    case Start::kPausing:
      return State::kPausing;
    case Start::kPaused:
      return State::kPaused;
    case Start::kWaiting:
      return State::kWaiting;
    case Start::kStopping:
      return State::kStopping;
    case Start::kFault:
      return State::kFault;
  }
  return State::kIdle;
}

constexpr std::string_view kDevices[] = {"none", "turntable", "arc",   "lamp",
                                         "C0",   "C1",        "laser", "lines"};

bool IsOf(const std::string& operation, std::string_view device) {
  if (device == "lamp" && operation == "levels") return true;
  return operation.starts_with(device);
}

class Walk : public LaserBench {
 public:
  Walk() {
    log.OnOperation([this](int, const std::string& operation) { return OnOperation(operation); });
  }
  ~Walk() { Release(); }

  // The sequencer's thread stands still in this operation.
  void BlockAt(std::string operation) {
    std::lock_guard lock(gate_mutex_);
    block_at_ = std::move(operation);
  }
  void AwaitBlocked() {
    std::unique_lock lock(gate_mutex_);
    changed_.wait(lock, [&] { return blocked_; });
  }
  void Release() {
    std::lock_guard lock(gate_mutex_);
    block_at_.clear();
    blocked_ = false;
    changed_.notify_all();
  }
  void Fail(std::string_view device, bool for_good) {
    if (device == "lines") return for_good ? lines.Break() : lines.FailReads(1);
    std::lock_guard lock(gate_mutex_);
    failing_ = device;
    for_good_ = for_good;
  }
  void Mend() {
    lines.Mend();
    std::lock_guard lock(gate_mutex_);
    failing_.clear();
  }
  void Reach(Start start) {
    switch (start) {
      case Start::kIdle:
        return;
      case Start::kArmed:
        ASSERT_EQ(Begin(plan, Command::kArm), OkStatus());
        return;
      case Start::kFault:
        Fail("arc", true);
        EXPECT_FALSE(Run(plan).complete);
        Mend();
        return;
      case Start::kWaiting:
        ASSERT_EQ(Begin(plan), OkStatus());
        AwaitEvent(SequencerEvent::Kind::kPrompt);
        return;
      case Start::kInSweep:
        BlockAt("laser read");
        ASSERT_EQ(Begin(plan), OkStatus());
        AwaitEvent(SequencerEvent::Kind::kPrompt);
        Visit();
        ASSERT_EQ(sequencer->Acknowledge(1), OkStatus());
        AwaitBlocked();
        return;
      case Start::kInShot:
      case Start::kPausing:
      case Start::kPaused:
      case Start::kStopping:
        BlockAt("C0 frame 2");
        ASSERT_EQ(Begin(plan), OkStatus());
        AwaitBlocked();
        if (start == Start::kStopping) {
          EXPECT_EQ(sequencer->Stop("before"), OkStatus());
        } else if (start != Start::kInShot) {
          EXPECT_EQ(sequencer->Command(Command::kPause, "before"), OkStatus());
        }
        if (start != Start::kPaused) return;
        Release();
        AwaitState(State::kPaused);
    }
  }
  Status Give(Command command) {
    switch (command) {
      case Command::kArm:
      case Command::kRun:
      case Command::kResume: {
        const auto fresh = std::make_shared<FakeSession>();
        fresh->Expect(plan);
        SessionJob job;
        job.plan = plan;
        job.session = fresh;
        job.resumed = command == Command::kResume;
        return Begin(command, std::move(job));
      }
      case Command::kStop:
        return sequencer->Stop("walk");
      case Command::kAcknowledge:
        return sequencer->Acknowledge(1);
      default:
        return sequencer->Command(command, "walk");
    }
  }
  // By commands alone.
  void ReachIdle() {
    for (int i = 0; i < 3 && sequencer->GetStatus().state != State::kIdle; ++i) {
      const State state = sequencer->GetStatus().state;
      EXPECT_EQ(Give(state == State::kFault ? Command::kReset : Command::kStop), OkStatus());
      AwaitStable();
    }
    EXPECT_EQ(sequencer->GetStatus().state, State::kIdle);
  }

  const CompiledPlan plan = SmallLaserPlan(rig);

 private:
  Status OnOperation(const std::string& operation) {
    std::unique_lock lock(gate_mutex_);
    if (!block_at_.empty() && operation == block_at_) {
      blocked_ = true;
      changed_.notify_all();
      changed_.wait(lock, [&] { return !blocked_; });
    }
    if (failing_.empty() || !IsOf(operation, failing_)) return OkStatus();
    if (!for_good_) failing_.clear();
    return Unavailable("{} broke", operation);
  }
  std::mutex gate_mutex_;
  std::condition_variable changed_;
  std::string block_at_, failing_;
  bool blocked_ = false, for_good_ = false;
};

// What a dead bank or motor unit leaves on is cut by its own time-out; everything else is off.
void ExpectOff(Walk& walk, std::string_view dead) {
  EXPECT_FALSE(dead != "lamp" && walk.lamps.anything_on());
  EXPECT_FALSE(walk.laser->moving());
  for (const auto& axis : walk.axes) {
    EXPECT_FALSE(axis->Read().enabled) << axis->name();
    EXPECT_FALSE(axis->Read().moving) << axis->name();
  }
  walk.LetTimePass(kLaserOneShot_s);
  EXPECT_FALSE(walk.lines.lit());
}

void WalkOnce(Start start, Command command, std::string_view device, bool for_good) {
  Walk walk;
  walk.Reach(start);
  const State before = walk.sequencer->GetStatus().state;
  ASSERT_EQ(before, StateOf(start));
  if (device != "none") walk.Fail(device, for_good);
  const Status given = walk.Give(command);
  if (!Allowed(before, command)) {
    EXPECT_TRUE(absl::IsFailedPrecondition(given)) << given;
    EXPECT_EQ(walk.sequencer->GetStatus().state, before);
  } else if (device == "none") {
    EXPECT_EQ(given, OkStatus());
  }
  walk.Release();
  const State after = walk.AwaitStable();
  ASSERT_TRUE(RowOf(after).off) << RowOf(after).name;
  ExpectOff(walk, for_good ? device : "none");
  walk.Mend();
  walk.ReachIdle();
  ExpectOff(walk, "none");
  walk.session = std::make_shared<FakeSession>();
  const SequencerEvent end = walk.RunWithOperator(walk.plan);
  EXPECT_TRUE(end.complete) << end.text;
  ExpectOff(walk, "none");
}

TEST(StateWalk, EveryStateCommandAndDeviceFaultEndsOffAndLeadsBack) {
  int walked = 0;
  for (const Start start : kStarts) {
    for (int command = 0; command < kSequencerCommands; ++command) {
      for (const std::string_view device : kDevices) {
        for (const bool for_good : {false, true}) {
          if (device == "none" && for_good) continue;
          SCOPED_TRACE(fmt::format(
              "{} ({}), {}, {} fails {}", RowOf(StateOf(start)).name, static_cast<int>(start),
              kCommandNames[static_cast<size_t>(command)], device, for_good ? "for good" : "once"));
          WalkOnce(start, static_cast<Command>(command), device, for_good);
          ++walked;
          if (::testing::Test::HasFatalFailure()) return;
        }
      }
    }
  }
  std::printf("walked %d combinations of %zu starts in %d states, %d commands, %zu devices\n",
              walked, std::size(kStarts), kSequencerStates, kSequencerCommands,
              std::size(kDevices) - 1);
  EXPECT_EQ(walked, 9 * 11 * (1 + 2 * 7));
}

}  // namespace
}  // namespace mesorig::daemon
