#include "daemon/control/sequencer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/daemon/fakes/bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<std::string> WithoutPolls(const std::vector<std::string>& operations) {
  std::vector<std::string> kept;
  for (const auto& operation : operations) {
    if (operation != "levels") kept.push_back(operation);
  }
  return kept;
}

TEST(Sequencer, RunsThePlanInOrder) {
  Bench bench;
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  EXPECT_THAT(
      WithoutPolls(bench.log.operations()),
      ElementsAre("lamps open", "lamps off", "C0 open", "C1 open", "turntable enable", "arc enable",
                  "turntable home", "arc home", "turntable homed", "arc homed",  // at the same time
                  "C0 exposure 0.02", "C1 exposure 0.02", "lamp 0", "turntable move 30",
                  "arc move -20",  // on the way, while the cameras warm up
                  "C0 trigger 1", "C1 trigger 1", "C0 frame 1", "C1 frame 1", "turntable there",
                  "arc there", "C0 trigger 2", "C1 trigger 2",
                  "lamp 2",  // while they read out
                  "C0 frame 2", "C1 frame 2", "C0 trigger 3", "C1 trigger 3", "turntable move 60",
                  "arc move 10", "C0 frame 3", "C1 frame 3", "C1 exposure 0.04", "turntable there",
                  "arc there", "C1 trigger 4", "C1 frame 4", "lamps off", "turntable disable",
                  "arc disable"));
  bench.ExpectAtRest();
  EXPECT_EQ(bench.session->Summary().end, SessionEnd::kComplete);
  const SequencerStatus status = bench.sequencer->GetStatus();
  EXPECT_EQ(status.state, SequencerState::kIdle);
  EXPECT_EQ(status.shots_done, 3u);
  EXPECT_EQ(status.frames, 5u);
  EXPECT_EQ(status.frames_durable, 5u);
  EXPECT_EQ(status.readings.size(), 6u);  // two axes, two lamps, e-stop, door
  EXPECT_GT(end.virtual_s, 3);
  EXPECT_EQ(bench.session->Summary().virtual_s, end.virtual_s);
}

TEST(Sequencer, RecordsWhatWasReadBack) {
  Bench bench;
  bench.Run(SmallPlan(bench.rig));
  const auto records = bench.session->records();
  ASSERT_EQ(records.size(), 5u);
  EXPECT_EQ(records[0].camera, 0);
  EXPECT_EQ(records[1].camera, 1);
  EXPECT_EQ(records[0].exposure_start_ns, records[1].exposure_start_ns) << "one instant";
  EXPECT_EQ(records[0].trigger_id, records[1].trigger_id);
  EXPECT_NEAR(records[0].axis_rad[0], RadFromDeg(30), 1e-12);
  EXPECT_NEAR(records[0].axis_rad[1], RadFromDeg(-20), 1e-12);
  EXPECT_NEAR(records[0].lamp_level[0], 1, 0.002);
  EXPECT_NEAR(records[0].lamp_level[1], 0, 0.002);
  EXPECT_NEAR(records[2].lamp_level[1], 1, 0.002);
  EXPECT_EQ(records[4].shot, 2u);
  EXPECT_EQ(records[4].exposure_s, 0.04);
  for (const auto& record : records) EXPECT_EQ(record.bytes, 16u * 8 * 2);
}

TEST(Sequencer, SecondRunDoesNotHomeAgain) {
  Bench bench;
  bench.Run(SmallPlan(bench.rig));
  const size_t before = bench.log.operations().size();
  bench.session = std::make_shared<FakeSession>();
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
  const auto operations = bench.log.operations();
  EXPECT_EQ(std::count(operations.begin() + before, operations.end(), "turntable home"), 0);
}

// Stop at every operation that a run makes: each time the rig is at rest and the session has ended.
TEST(Sequencer, StopsAtEveryPoint) {
  const int operations = OperationsOfSmallPlan();
  ASSERT_GT(operations, 40);
  for (int at = 1; at < operations; ++at) {  // 0 is the reading before any plan
    SCOPED_TRACE(at);
    Bench bench;
    std::string stopped_in;
    bench.log.OnOperation([&](int index, const std::string& operation) {
      if (index == at) {
        stopped_in = operation;
        EXPECT_EQ(bench.sequencer->Stop("a hand said stop"), OkStatus());
      }
      return OkStatus();
    });
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    SCOPED_TRACE(stopped_in);
    bench.ExpectAtRest();
    EXPECT_EQ(bench.session->finishes(), 1);
    EXPECT_EQ(end.status.state, SequencerState::kIdle);
    // Of the last ones the plan itself was done.
    if (end.complete) {
      EXPECT_EQ(bench.session->records().size(), 5u);
    } else {
      bench.ExpectIncomplete("a hand said stop");
    }
  }
}

// The same with a failure at every operation.
TEST(Sequencer, FailsSafeAtEveryPoint) {
  const int operations = OperationsOfSmallPlan();
  for (int at = 1; at < operations; ++at) {
    SCOPED_TRACE(at);
    Bench bench;
    bench.log.OnOperation([&](int index, const std::string& operation) {
      return index == at ? Unavailable("{} broke", operation) : OkStatus();
    });
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    EXPECT_TRUE(end.complete) << end.text;
    bench.ExpectAtRest();
    EXPECT_EQ(bench.session->records().size(), 5u) << "nothing is taken twice";
    EXPECT_EQ(end.status.state, SequencerState::kIdle);
  }
}

// A device that stays broken: a fault that names it, after as many tries as docs/running.md says.
TEST(Sequencer, ADeviceThatDoesNotComeBackIsAFault) {
  Bench bench;
  bool broken = true;
  bench.log.OnOperation([&](int, const std::string& operation) {
    return broken && operation.starts_with("arc move") ? Unavailable("{} broke", operation)
                                                       : OkStatus();
  });
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("3 recoveries did not help: arc move -20 broke");
  EXPECT_EQ(end.status.state, SequencerState::kFault);
  EXPECT_GT(end.virtual_s, 0.5 + 2 + 8);
  // A fault does not forbid the next start.
  broken = false;
  bench.session = std::make_shared<FakeSession>();
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
}

TEST(Sequencer, RecoveriesCountAgainAfterEachShot) {
  Bench bench;
  int failures = 0;
  bench.log.OnOperation([&](int, const std::string& operation) {
    const bool fails = operation.starts_with("C1 frame") && ++failures % 3 != 0;
    return fails ? Unavailable("{} broke", operation) : OkStatus();
  });
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  bench.ExpectAtRest();
}

TEST(Sequencer, DoorThatOpensEndsTheRunAndNamesTheLine) {
  Bench bench;
  bench.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "arc move -20") {
      bench.lines.Set(1, false);
      bench.lines.Set(1, true);  // closing brings nothing back
    }
    return OkStatus();
  });
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  EXPECT_EQ(end.status.state, SequencerState::kFault);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("door (line 1) opened");
  EXPECT_TRUE(bench.session->records().empty());
}

TEST(Sequencer, ChainThatCannotBeReadIsOpen) {
  Bench bench;
  bench.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "C0 trigger 1") bench.lines.Break();
    return OkStatus();
  });
  bench.Run(SmallPlan(bench.rig));
  bench.ExpectAtRest();
  bench.ExpectIncomplete("emergency stop (line 0) cannot be read");
}

TEST(Sequencer, OpenChainRefusesTheStart) {
  Bench bench;
  bench.lines.Set(0, false);
  const Status status = bench.Begin(SmallPlan(bench.rig));
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_THAT(std::string(Message(status)), HasSubstr("emergency stop (line 0) is open"));
  EXPECT_EQ(bench.session->finishes(), 0);
  bench.lines.Set(0, true);
  EXPECT_THAT(std::string(Message(bench.Begin(SmallPlan(bench.rig)))), HasSubstr("press reset"));
  bench.PressReset();
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
}

TEST(Sequencer, NoLaserWithoutAnInterlock) {
  Rig rig = SmallLaserRig();
  rig.lines.interlock = false;
  rig.lines.estop = rig.lines.door = rig.lines.reset = -1;
  Bench bench(rig);
  const Status refused = bench.Begin(SmallLaserPlan(bench.rig));
  EXPECT_TRUE(absl::IsFailedPrecondition(refused));
  EXPECT_THAT(std::string(Message(refused)), HasSubstr("has no interlock"));
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete) << "lamps and axes only";
}

TEST(Sequencer, OneRunAtATimeAndOnlyPlansOfThisRig) {
  Bench bench;
  CompiledPlan other = SmallPlan(bench.rig);
  other.rig_sha256 = "another";
  EXPECT_TRUE(absl::IsInvalidArgument(bench.Begin(other)));
  Status second;
  bench.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "arc enable") {
      second = bench.sequencer->Begin(SequencerCommand::kRun,
                                      {SmallPlan(bench.rig), std::make_shared<FakeSession>()});
    }
    return OkStatus();
  });
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
}

TEST(Sequencer, ShootsAMissingFrameAgain) {
  Bench bench;
  bench.cameras[1]->lost_triggers = {3, 4};  // 1 was the warm-up
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  const auto records = bench.session->records();
  ASSERT_EQ(records.size(), 5u);
  EXPECT_EQ(records[2].camera, 0);
  EXPECT_EQ(records[2].trigger_id, 3u);
  EXPECT_EQ(records[3].camera, 1);
  EXPECT_EQ(records[3].shot, 1u);
  EXPECT_EQ(records[3].trigger_id, 5u);
  EXPECT_EQ(records[3].supersedes, 0u);
  const auto operations = bench.log.operations();
  EXPECT_EQ(std::count(operations.begin(), operations.end(), "C0 trigger 4"), 0)
      << "only who owes a frame is triggered again";
}

TEST(Sequencer, GivesUpOnACameraThatStaysSilent) {
  Bench bench;
  for (uint32_t trigger = 3; trigger < 100; ++trigger) {
    bench.cameras[1]->lost_triggers.insert(trigger);
  }
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("camera C1");
  EXPECT_EQ(end.status.state, SequencerState::kFault);
}

TEST(Sequencer, DimLampIsNotSteadyLight) {
  Bench bench;
  bench.lamps.brightest = 0.99;
  bench.Run(SmallPlan(bench.rig));
  bench.ExpectAtRest();
  bench.ExpectIncomplete("lamp L0: light not steady after 2.000 s");
  EXPECT_EQ(bench.session->Journaled(JournalKind::kRecovered), 3);
}

TEST(Sequencer, BrokenSessionEndsTheRun) {
  Bench bench;
  bench.session->append_result = Unavailable("disk full");
  bench.Run(SmallPlan(bench.rig));
  bench.ExpectAtRest();
  bench.ExpectIncomplete("disk full");
}

TEST(Sequencer, NoSuccessWithoutReconciliation) {
  Bench bench;
  bench.session->finish_result = DataLoss("one frame too few");
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  EXPECT_THAT(end.text, HasSubstr("one frame too few"));
  EXPECT_EQ(end.status.state, SequencerState::kFault);
}

TEST(Sequencer, IdleStopSwitchesLampsOff) {
  Bench bench;
  EXPECT_EQ(bench.sequencer->Stop("nothing runs"), OkStatus());
  EXPECT_THAT(bench.log.operations(), ::testing::Contains("lamps off"));
  EXPECT_EQ(bench.sequencer->GetStatus().state, SequencerState::kIdle);
}

}  // namespace
}  // namespace mesorig::daemon
