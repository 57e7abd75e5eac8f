// The sequencer with real drivers on the simulator's devices, in lockstep: equal runs give equal
// ledgers and pixels, and what goes wrong at the rig ends with the rig at rest.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "protocol/base/digest.h"
#include "tests/daemon/fakes/session_bench.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

using Bench = SessionBench;

std::string History(const Bench& bench) {
  std::string history;
  for (const FrameRecord& r : bench.session->records()) {
    history += fmt::format("{} {} {} {} {} {} ", r.camera, r.shot, r.trigger_id, r.frame_id,
                           r.exposure_start_ns, r.digest);
    for (const double x : r.axis_rad) history += fmt::format("{:.17g} ", x);
    for (const double x : r.lamp_level) history += fmt::format("{:.17g} ", x);
    history += "\n";
  }
  return history;
}

TEST(LockstepRun, EqualRunsGiveEqualLedgersAndPixels) {
  std::string first;
  for (int run = 0; run < 10; ++run) {
    Bench bench;
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    ASSERT_TRUE(end.complete) << end.text;
    EXPECT_TRUE(end.status.deterministic);
    ASSERT_EQ(bench.session->records().size(), 5u);
    bench.ExpectAtRest();
    const std::string history = History(bench) + fmt::format("{:.9f}", end.virtual_s);
    if (run == 0) first = history;
    ASSERT_EQ(history, first) << "run " << run;
  }
  EXPECT_THAT(first, HasSubstr("0.5235987")) << "30 deg\n" << first;
}

TEST(LockstepRun, DoorThatOpensMidMove) {
  Bench bench;
  const SequencerStatus before = bench.sequencer->GetStatus();
  EXPECT_EQ(before.state, SequencerState::kIdle);
  bench.sim.Exclusive([&](RigTime now) {
    bench.sim.hand.At(now + milliseconds(5200), [&](RigTime t) {
      sim_wire::Outbox lost;  // the edge gets lost: levels are the truth
      EXPECT_TRUE(bench.sim.lines.Inject(t, "door open", lost).ok());
    });
  });
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_FALSE(end.complete);
  EXPECT_EQ(end.status.state, SequencerState::kFault);
  EXPECT_THAT(bench.session->Summary().reason, HasSubstr("door (line 1) is open"));
  bench.ExpectAtRest();
}

TEST(LockstepRun, StopByHandInTheMiddle) {
  Bench bench;
  std::thread hand;
  bench.sim.Exclusive([&](RigTime now) {
    bench.sim.hand.At(now + milliseconds(4000), [&](RigTime) {
      hand = std::thread([&] { EXPECT_EQ(bench.sequencer->Stop("a hand said stop"), OkStatus()); });
      // Time stands still until the stop has been heard.
      while (bench.sequencer->GetStatus().state == SequencerState::kRunning) {
        std::this_thread::yield();
      }
    });
  });
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  hand.join();
  EXPECT_FALSE(end.complete);
  EXPECT_EQ(bench.session->Summary().reason, "a hand said stop");
  EXPECT_EQ(end.status.state, SequencerState::kIdle);
  EXPECT_NEAR(end.virtual_s, 4, 1) << "stopped where it was, less the way to rest";
  bench.ExpectAtRest();
}

}  // namespace
}  // namespace mesorig::daemon
