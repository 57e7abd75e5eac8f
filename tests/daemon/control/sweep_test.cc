#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/laser_bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using Kind = SequencerEvent::Kind;

TEST(Sweep, TakesEveryFrameWithItsPlaceAndRegion) {
  LaserBench bench;
  const SequencerEvent end = bench.RunWithOperator(SmallLaserPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  bench.ExpectAtRest();
  const auto records = bench.session->records();
  ASSERT_EQ(records.size(), 32u);
  EXPECT_FALSE(records[0].laser.has_value());
  uint32_t shot = 1;
  for (size_t i = 2; i < records.size(); i += 2, ++shot) {
    SCOPED_TRACE(shot);
    const FrameRecord &first = records[i], &second = records[i + 1];
    EXPECT_EQ(first.shot, shot);
    EXPECT_EQ(first.trigger_id, second.trigger_id);
    ASSERT_TRUE(first.laser && second.laser);
    EXPECT_EQ(first.laser->sweep, (shot - 1) / 5);
    EXPECT_EQ(first.laser->index, (shot - 1) % 5);
    EXPECT_EQ(first.laser->mount, shot <= 10 ? 0 : 1);
    EXPECT_TRUE(first.laser->on);
    // Five frames from -0.05 to 0.05 rad at 10 Hz; the gate takes 10 ms to open.
    EXPECT_NEAR(first.laser->tilt_rad, -0.05 + 0.025 * (first.laser->index + 0.1), 1e-6);
    EXPECT_EQ(first.region_x, 2);
    EXPECT_EQ(first.region_y, 2);
    EXPECT_EQ(first.width, 8);
    EXPECT_EQ(first.bytes, 8u * 4 * 2);
    EXPECT_EQ(second.bytes, 16u * 8 * 2);
    EXPECT_NEAR(first.lamp_level[0], 0, 0.002) << "lamps are dark";
  }
  ASSERT_EQ(bench.prompts.size(), 2u);
  EXPECT_EQ(bench.prompts[0].mount, "high");
  EXPECT_EQ(bench.prompts[1].mount, "low");
  EXPECT_EQ(bench.prompts[1].id, 2u);
}

// The laser never shines while an axis moves or torque is switched, and is lit for every frame.
TEST(Sweep, LightStaysInsideTheSweep) {
  LaserBench bench;
  bench.log.OnOperation([&](int, const std::string& operation) {
    const bool of_axes = operation.starts_with("turntable") || operation.starts_with("arc");
    if (of_axes || operation.starts_with("laser prepare")) {
      EXPECT_FALSE(bench.lines.lit()) << operation;
    }
    if (operation == "laser read") {
      EXPECT_TRUE(bench.lines.lit()) << operation;
    }
    return OkStatus();
  });
  EXPECT_TRUE(bench.RunWithOperator(SmallLaserPlan(bench.rig)).complete);
  EXPECT_GT(bench.lines.edges(), 3 * 4);
  EXPECT_FALSE(bench.lines.lit());
}

// The dark is measured after a way of the emitter that outlasted the lamps' settling many times.
TEST(Sweep, LongWayOfTheEmitterIsNoUnsteadyLight) {
  LaserBench bench;
  bench.laser->prepare_s = 60;
  EXPECT_TRUE(bench.RunWithOperator(SmallLaserPlan(bench.rig)).complete);
  for (const SequencerEvent& event : bench.events) {
    EXPECT_NE(event.kind, Kind::kNote) << event.text;
  }
}

// The operator's three signs, each alone, in the wrong order, then right.
TEST(Sweep, PromptWaitsForDoorResetAndConsole) {
  LaserBench bench;
  EXPECT_EQ(bench.Begin(SmallLaserPlan(bench.rig)), OkStatus());
  bench.AwaitEvent(Kind::kPrompt);
  EXPECT_EQ(bench.sequencer->GetStatus().state, SequencerState::kWaiting);
  EXPECT_FALSE(bench.lamps.anything_on());
  for (const auto& axis : bench.axes) EXPECT_FALSE(axis->Read().enabled) << "torque is off";
  EXPECT_FALSE(bench.lines.lit());
  EXPECT_TRUE(absl::IsFailedPrecondition(bench.sequencer->Acknowledge(2)));
  EXPECT_EQ(bench.sequencer->Acknowledge(1), OkStatus());
  const auto& lines = bench.rig.lines;
  const auto expect = [&](bool door_cycled, bool reset) {
    const auto prompt = bench.sequencer->GetStatus().prompt;
    ASSERT_TRUE(prompt.has_value());
    EXPECT_TRUE(prompt->acknowledged);
    EXPECT_EQ(prompt->door_cycled, door_cycled);
    EXPECT_EQ(prompt->reset, reset);
    EXPECT_EQ(bench.session->records().size(), 2u) << "nothing runs";
  };
  bench.lines.Set(lines.reset, false);
  bench.lines.Set(lines.reset, true);  // before the door: counts for nothing
  expect(false, false);
  bench.lines.Set(lines.door, false);
  bench.lines.Set(lines.reset, false);
  bench.lines.Set(lines.reset, true);  // with the door open: nothing
  expect(false, false);
  bench.lines.Set(lines.door, true);
  expect(true, false);
  bench.lines.Set(lines.door, false);  // opened again: hands may be inside
  expect(false, false);
  bench.lines.Set(lines.door, true);
  expect(true, false);
  bench.lines.Set(lines.reset, false);
  bench.lines.Set(lines.reset, true);
  bench.AwaitEvent(Kind::kPrompt, 2);  // the next one: the first mount's sweeps are done
  EXPECT_EQ(bench.session->records().size(), 22u);
  EXPECT_EQ(bench.sequencer->Stop("enough"), OkStatus());
  bench.AwaitEvent(Kind::kEnded);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("enough");
}

TEST(Sweep, ChainThatIsOpenAfterTheVisitEndsTheRun) {
  LaserBench bench;
  EXPECT_EQ(bench.Begin(SmallLaserPlan(bench.rig)), OkStatus());
  bench.AwaitEvent(Kind::kPrompt);
  bench.lines.Set(bench.rig.lines.estop, false);
  bench.Visit();
  EXPECT_EQ(bench.sequencer->Acknowledge(1), OkStatus());
  bench.AwaitEvent(Kind::kEnded);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("emergency stop");
}

// A frame that does not come is taken on another way of the emitter, and only that one.
TEST(Sweep, MissingFrameIsTakenOnAnotherSweep) {
  LaserBench bench;
  // The third frame of the first sweep: two warm-ups and a shot were before.
  bench.cameras[1]->lost_triggers = {6};
  EXPECT_TRUE(bench.RunWithOperator(SmallLaserPlan(bench.rig)).complete);
  const auto records = bench.session->records();
  ASSERT_EQ(records.size(), 32u);
  int of_the_lost = 0;
  for (const auto& record : records) of_the_lost += record.shot == 3 && record.camera == 1;
  EXPECT_EQ(of_the_lost, 1);
  const auto operations = bench.log.operations();
  EXPECT_EQ(std::count(operations.begin(), operations.end(), "laser sweep"), 4);
}

TEST(Sweep, LaserThatGoesOffEndsTheRun) {
  LaserBench bench;
  bench.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "C0 trigger 5") bench.lines.AddOneShot(-2, bench.rig.lines.laser_on);
    return OkStatus();
  });
  const SequencerEvent end = bench.RunWithOperator(SmallLaserPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  bench.ExpectAtRest();
  bench.ExpectIncomplete("laser");
}

// Stop, and failure, at every operation: at rest, dark and ended each time.
TEST(Sweep, StopsAndFailsSafeAtEveryPoint) {
  int operations = 0;
  {
    LaserBench whole;
    EXPECT_TRUE(whole.RunWithOperator(SmallLaserPlan(whole.rig)).complete);
    operations = whole.operations();
  }
  ASSERT_GT(operations, 150);
  for (int at = 1; at < operations; ++at) {
    for (const bool stop : {true, false}) {
      LaserBench bench;
      std::string hit;
      bench.log.OnOperation([&](int index, const std::string& operation) -> Status {
        if (index != at) return OkStatus();
        hit = operation;
        if (!stop) return Unavailable("{} broke", operation);
        return bench.sequencer->Stop("a hand said stop");
      });
      const SequencerEvent end = bench.RunWithOperator(SmallLaserPlan(bench.rig));
      SCOPED_TRACE(fmt::format("{} {} {}", at, stop ? "stopped in" : "failed in", hit));
      bench.ExpectAtRest();
      bench.LetTimePass(kLaserOneShot_s);
      EXPECT_FALSE(bench.lines.lit());
      EXPECT_EQ(bench.session->finishes(), 1);
      EXPECT_TRUE(stop || end.complete) << end.text;
      if (!end.complete) bench.ExpectIncomplete("a hand said stop");
    }
  }
}

}  // namespace
}  // namespace mesorig::daemon
