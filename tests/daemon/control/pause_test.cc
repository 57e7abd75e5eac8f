// Pauses, by hand and for the disk, aborts, and what the chain has to say.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "tests/daemon/fakes/laser_bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using Command = SequencerCommand;
using State = SequencerState;

// A bench that is given a command in an operation of its run.
class PauseBench : public Bench {
 public:
  void GiveIn(std::string operation, Command command) {
    log.OnOperation([this, operation = std::move(operation), command](int, const std::string& now) {
      if (now == operation && !given_.exchange(true)) {
        EXPECT_EQ(sequencer->Command(command, "a hand"), OkStatus());
      }
      return OkStatus();
    });
  }
  int Count(std::string_view operation) const {
    const auto operations = log.operations();
    return static_cast<int>(std::count(operations.begin(), operations.end(), operation));
  }

 private:
  std::atomic<bool> given_{false};
};

TEST(Pause, AtTheNextSafeStepFinishesTheShot) {
  PauseBench bench;
  bench.GiveIn("C0 frame 2", Command::kPause);
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
  bench.AwaitState(State::kPaused);
  EXPECT_EQ(bench.session->records().size(), 2u) << "the shot under way is finished";
  bench.ExpectAtRest();
  const RigTime paused_at = bench.clock.Now();
  EXPECT_EQ(bench.sequencer->GetStatus().message, "a hand");
  EXPECT_EQ(bench.sequencer->Command(Command::kContinue, ""), OkStatus());
  const SequencerEvent end = bench.AwaitEnd();
  EXPECT_TRUE(end.complete) << end.text;
  EXPECT_EQ(bench.session->records().size(), 5u);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kPaused), 1);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kContinued), 1);
  EXPECT_GT(bench.clock.Now(), paused_at);
  EXPECT_EQ(bench.Count("turntable home"), 1) << "the reference is still good";
  bench.ExpectAtRest();
}

TEST(Pause, NowGivesTheShotUpAndTakesItAgain) {
  PauseBench bench;
  bench.GiveIn("C0 frame 2", Command::kPauseNow);
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
  bench.AwaitState(State::kPaused);
  EXPECT_TRUE(bench.session->records().empty());
  bench.ExpectAtRest();
  EXPECT_EQ(bench.sequencer->Command(Command::kContinue, ""), OkStatus());
  EXPECT_TRUE(bench.AwaitEnd().complete);
  EXPECT_EQ(bench.session->records().size(), 5u);
}

// bluesky 1647: pause and continue at once, at every operation.
TEST(Pause, AtEveryPointAndGoesOn) {
  const int operations = OperationsOfSmallPlan();
  for (int at = 1; at < operations; ++at) {
    for (const Command command : {Command::kPause, Command::kPauseNow}) {
      Bench bench;
      bool given = false;
      bench.log.OnOperation([&](int index, const std::string&) {
        if (index == at) given = bench.sequencer->Command(command, "a hand").ok();
        return OkStatus();
      });
      ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
      const State state = bench.AwaitStable();
      SCOPED_TRACE(fmt::format("{} {}", at, static_cast<int>(command)));
      bench.ExpectAtRest();
      if (state == State::kPaused) {
        EXPECT_TRUE(given);
        EXPECT_EQ(bench.sequencer->Command(Command::kContinue, ""), OkStatus());
      }
      const SequencerEvent end = bench.AwaitEnd();
      EXPECT_TRUE(end.complete) << end.text;
      EXPECT_EQ(bench.session->records().size(), 5u);
    }
  }
}

TEST(Pause, TheDiskPausesAndGoesOnByItself) {
  PauseBench bench;
  std::atomic<bool> full{false};
  bench.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "C0 frame 2" && !full.exchange(true)) {
      bench.session->SetStorage(Unavailable("C0.seg: write: no space left on device"));
    }
    return OkStatus();
  });
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
  bench.AwaitState(State::kPaused);
  const SequencerStatus status = bench.sequencer->GetStatus();
  EXPECT_THAT(status.message, HasSubstr("no space left"));
  EXPECT_THAT(status.storage, HasSubstr("no space left"));
  bench.ExpectAtRest();
  bench.session->SetStorage(OkStatus());
  const SequencerEvent end = bench.AwaitEnd();
  EXPECT_TRUE(end.complete) << end.text;
  EXPECT_EQ(bench.session->records().size(), 5u);
}

TEST(Pause, ByHandIsNotEndedByTheDisk) {
  PauseBench bench;
  bench.GiveIn("C0 frame 2", Command::kPause);
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
  bench.AwaitState(State::kPaused);
  bench.session->SetStorage(Unavailable("full"));
  bench.session->SetStorage(OkStatus());
  EXPECT_EQ(bench.sequencer->GetStatus().state, State::kPaused);
  EXPECT_EQ(bench.sequencer->Stop("enough"), OkStatus());
  EXPECT_FALSE(bench.AwaitEnd().complete);
  bench.ExpectIncomplete("enough");
}

TEST(Pause, AChainThatOpenedAsksForReset) {
  PauseBench bench;
  bench.GiveIn("C0 frame 2", Command::kPause);
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig)), OkStatus());
  bench.AwaitState(State::kPaused);
  const auto& lines = bench.rig.lines;
  const auto refused = [&](std::string_view why) {
    const Status status = bench.sequencer->Command(Command::kContinue, "");
    EXPECT_TRUE(absl::IsFailedPrecondition(status));
    EXPECT_THAT(std::string(Message(status)), HasSubstr(std::string(why)));
    EXPECT_EQ(bench.sequencer->GetStatus().state, State::kPaused);
  };
  bench.lines.Set(lines.estop, false);
  refused("emergency stop");
  bench.lines.Set(lines.reset, false);
  bench.lines.Set(lines.reset, true);  // with the chain open: nothing
  bench.lines.Set(lines.estop, true);
  refused("press reset");
  bench.lines.Set(lines.reset, false);
  bench.lines.Set(lines.reset, true);
  EXPECT_EQ(bench.sequencer->Command(Command::kContinue, ""), OkStatus());
  EXPECT_TRUE(bench.AwaitEnd().complete);
}

TEST(Abort, ParksAtHomeWhenTheChainIsClosed) {
  PauseBench bench;
  bench.GiveIn("C0 frame 2", Command::kAbort);
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  EXPECT_EQ(end.status.state, State::kIdle);
  bench.ExpectIncomplete("a hand");
  bench.ExpectAtRest();
  for (const auto& axis : bench.axes) EXPECT_EQ(axis->Read().position_rad, 0) << axis->name();
}

TEST(Abort, MovesNothingWhileHandsMayBeInTheRig) {
  LaserBench bench;
  ASSERT_EQ(bench.Begin(SmallLaserPlan(bench.rig)), OkStatus());
  bench.AwaitEvent(SequencerEvent::Kind::kPrompt);
  const size_t before = bench.log.operations().size();
  EXPECT_EQ(bench.sequencer->Command(Command::kAbort, "enough"), OkStatus());
  EXPECT_FALSE(bench.AwaitEnd().complete);
  const auto operations = bench.log.operations();
  for (size_t i = before; i < operations.size(); ++i) {
    EXPECT_EQ(operations[i].find("enable"), std::string::npos) << operations[i];
  }
  bench.ExpectAtRest();
  bench.ExpectIncomplete("enough");
}

TEST(Arm, WaitsForStartWithEverythingOff) {
  Bench bench;
  ASSERT_EQ(bench.Begin(SmallPlan(bench.rig), Command::kArm), OkStatus());
  EXPECT_EQ(bench.sequencer->GetStatus().state, State::kArmed);
  bench.ExpectAtRest();
  bench.lines.Set(bench.rig.lines.door, false);
  EXPECT_TRUE(absl::IsFailedPrecondition(bench.sequencer->Command(Command::kStart, "")));
  bench.lines.Set(bench.rig.lines.door, true);
  EXPECT_TRUE(absl::IsFailedPrecondition(bench.sequencer->Command(Command::kStart, "")))
      << "closing permits nothing";
  bench.PressReset();
  EXPECT_EQ(bench.sequencer->Command(Command::kStart, ""), OkStatus());
  EXPECT_TRUE(bench.AwaitEnd().complete);
}

TEST(Refusal, NamesTheStateAndWhatIsPossible) {
  Bench bench;
  const Status status = bench.sequencer->Command(Command::kContinue, "");
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_EQ(std::string(Message(status)),
            "continue is not possible while idle; possible is: arm, run, stop, resume");
}

TEST(Prompt, AnyRequestTakesAVisitAndIsAskedBeforeItsShots) {
  LaserBench bench;
  CompiledPlan plan = SmallPlan(bench.rig);
  const Step prompt = PromptStep("Put the white diffuser on the table");
  plan.steps.insert(plan.steps.begin() + 5, prompt);
  plan.prompts = 1;
  const SequencerEvent end = bench.RunWithOperator(plan);
  EXPECT_TRUE(end.complete) << end.text;
  ASSERT_EQ(bench.prompts.size(), 1u);
  EXPECT_EQ(bench.prompts[0].text, prompt.text);
  EXPECT_EQ(bench.prompts[0].mount, "");
  EXPECT_EQ(bench.session->Journaled(JournalKind::kPrompt), 1);
  bench.ExpectAtRest();
}

TEST(Prompt, AfterTheLastFrameTheRigRestsAndAsks) {
  LaserBench bench;
  CompiledPlan plan = SmallPlan(bench.rig);
  const Step prompt = PromptStep("Take the sample out");
  plan.steps.push_back(prompt);
  plan.prompts = 1;
  const SequencerEvent end = bench.RunWithOperator(plan);
  EXPECT_TRUE(end.complete) << end.text;
  ASSERT_EQ(bench.prompts.size(), 1u);
  EXPECT_EQ(bench.prompts[0].text, prompt.text);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kContinued), 1);
  bench.ExpectAtRest();
}

}  // namespace
}  // namespace mesorig::daemon
