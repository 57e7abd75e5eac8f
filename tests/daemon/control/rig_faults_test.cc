// What breaks at the rig itself while a session runs: an axis that slips on its shaft, a drive or a
// lamp's housing that is too hot, a relay that sticks. Each is found, named, and ends with light and
// torque off by the simulator's own state.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/session_bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

// Among the shots.
constexpr RigTime kMidway = std::chrono::milliseconds(5200);

// A session that was cut short goes on: its axes home again, and the count has them elsewhere.
TEST(RigFaults, ASlippedAxisIsFoundByHomingAgain) {
  for (const double slip_deg : {3.0, -0.5}) {
    SessionBench bench;
    const CompiledPlan plan = SmallPlan(bench.rig);
    ASSERT_TRUE(bench.Run(plan).complete);
    bench.session->Reopen();
    bench.session->Lose(1, 0);
    ASSERT_EQ(bench.sim.Inject(fmt::format("can turntable slip {}", slip_deg)), OkStatus());
    const SequencerEvent end = bench.Run(plan, SequencerCommand::kResume);
    EXPECT_FALSE(end.complete);
    EXPECT_EQ(end.status.state, SequencerState::kFault);
    EXPECT_THAT(end.text, HasSubstr("axis turntable (node 5): homing found the reference at"));
    EXPECT_THAT(end.text, HasSubstr(fmt::format("at {:.4f} deg by the count", -slip_deg)));
    EXPECT_THAT(end.text, HasSubstr("permitted is 0 within 0.1 deg"));
    EXPECT_EQ(bench.session->records().size(), 5u) << "nothing was taken after it";
    bench.ExpectAtRest();
    // A person has decided: the new reference is good.
    ASSERT_EQ(bench.sequencer->Command(SequencerCommand::kReset, "known"), OkStatus());
    bench.session->Reopen();
    const SequencerEvent again = bench.Run(plan, SequencerCommand::kResume);
    EXPECT_TRUE(again.complete) << again.text;
    bench.ExpectAtRest();
  }
}

TEST(RigFaults, ASlipWithinTheToleranceIsNone) {
  SessionBench bench;
  const CompiledPlan plan = SmallPlan(bench.rig);
  ASSERT_TRUE(bench.Run(plan).complete);
  bench.session->Reopen();
  bench.session->Lose(1, 0);
  ASSERT_EQ(bench.sim.Inject("can turntable slip 0.05"), OkStatus());
  const SequencerEvent end = bench.Run(plan, SequencerCommand::kResume);
  EXPECT_TRUE(end.complete) << end.text;
}

TEST(RigFaults, AHotDriveEndsTheSessionUnlessItCools) {
  for (const std::string axis : {"turntable", "arc"}) {
    SessionBench bench({{kMidway, "can " + axis + " hot"}});
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    EXPECT_FALSE(end.complete);
    EXPECT_EQ(end.status.state, SequencerState::kFault);
    EXPECT_THAT(end.text, HasSubstr("axis " + axis));
    EXPECT_THAT(end.text, HasSubstr("0x4310 (excess temperature of the drive)"));
    bench.ExpectAtRest();
  }
  SessionBench cools({{kMidway, "can arc hot"}, {kMidway + FromSeconds(0.3), "can arc cool"}});
  const SequencerEvent end = cools.Run(SmallPlan(cools.rig));
  EXPECT_TRUE(end.complete) << end.text;
  cools.ExpectAtRest();
}

TEST(RigFaults, AHotHousingEndsTheSession) {
  Rig rig = SmallRig();
  rig.lamp_bank.housing_temperatures = true;
  rig.lamp_bank.max_housing_c = 200;
  SessionBench bench({{kMidway, "lamps heat L1 260"}}, rig);
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  EXPECT_EQ(end.status.state, SequencerState::kFault);
  EXPECT_THAT(end.text, HasSubstr("lamp L1: its housing has 2"));
  EXPECT_THAT(end.text, HasSubstr("degrees C, permitted are 200"));
  bench.ExpectAtRest();
}

// The bank is gone when the session ends, with a lamp lit, and comes back: its own timeout puts the
// lamp out, since nobody's looking keeps it alive; or, where that is long, the safety thread does.
TEST(RigFaults, ALampBankThatComesBackLitIsPutOut) {
  for (const double timeout_s : {4.0, 600.0}) {
    Rig rig = SmallRig();
    rig.lamp_bank.timeout_s = timeout_s;
    SessionBench bench({{kMidway, "lamps disconnect"}, {kMidway + FromSeconds(14), "lamps replug"}}, rig);
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    EXPECT_FALSE(end.complete);
    EXPECT_THAT(end.text, HasSubstr("lamps off: lamp bank"));
    const auto lit = [&] {
      bool any = false;
      bench.sim.Exclusive([&](RigTime) {
        for (const double level : bench.sim.lamps.CommandedLevels()) any |= level > 0;
      });
      return any;
    };
    EXPECT_TRUE(lit()) << "a moment after the end";
    {
      RigClock::Member member(*bench.end.link, "test");
      RigClock::Activity activity(*bench.end.link, Pace::kFree);
      bench.end.link->SleepFor(FromSeconds(14 + Safety::kOffRetry_s + 1));
    }
    EXPECT_FALSE(lit()) << timeout_s;
    bench.ExpectAtRest();
  }
}

// No telegram opens a relay that sticks: what the daemon can switch off is off, it says which lamp
// and what helps, nothing can be started, and the contactor cuts the rest.
TEST(RigFaults, ALampThatSticksIsNamedAndTheContactorPutsItOut) {
  SessionBench bench;
  bench.sim.Exclusive([&](RigTime) {
    bench.sim.lamps.OnPower([&](size_t lamp, bool on, RigTime t) {
      sim_wire::Outbox unused;
      if (lamp != 0 || !on) return;
      EXPECT_EQ(bench.sim.lamps.Inject(t, "stuck L0", unused), OkStatus());
    });
  });
  const CompiledPlan plan = SmallPlan(bench.rig);
  const SequencerEvent end = bench.Run(plan);
  EXPECT_FALSE(end.complete);
  EXPECT_THAT(end.text, HasSubstr("lamp L0 is lit, level 1.000, and nobody asked for it"));
  bench.sim.Exclusive([&](RigTime now) {
    EXPECT_EQ(bench.sim.lamps.CommandedLevels(), (std::vector<double>{1, 0}));
    EXPECT_FALSE(bench.sim.lamps.Coil(bench.rig.lamps[0].channel)) << "told to go off";
    for (size_t i = 0; i < 2; ++i) {
      EXPECT_FALSE(bench.sim.can.node(i).torque_on());
      EXPECT_FALSE(bench.sim.can.node(i).Moving(now));
    }
  });
  (void)bench.sequencer->Command(SequencerCommand::kReset, "try");
  const Status refused = bench.sequencer->CheckBegin(SequencerCommand::kRun, plan);
  EXPECT_THAT(std::string(Message(refused)), HasSubstr("lamp L0 is lit"));
  ASSERT_EQ(bench.sim.Inject("lines estop open"), OkStatus());
  bench.ExpectAtRest();
  bench.sim.Exclusive([&](RigTime) { bench.sim.lamps.OnPower({}); });
  ASSERT_EQ(bench.sim.Inject("lamps alive L0"), OkStatus());
  ASSERT_EQ(bench.sim.Inject("lines estop close"), OkStatus());
  EXPECT_FALSE(bench.sequencer->CheckBegin(SequencerCommand::kRun, plan).ok());
  ASSERT_EQ(bench.sim.Inject("lines reset"), OkStatus());
  EXPECT_FALSE(bench.sequencer->CheckBegin(SequencerCommand::kRun, plan).ok()) << "it still glows";
  bench.Pass(2);
  const SequencerEvent again = bench.Run(plan);
  EXPECT_TRUE(again.complete) << again.text;
  bench.ExpectAtRest();
}

}  // namespace
}  // namespace mesorig::daemon
