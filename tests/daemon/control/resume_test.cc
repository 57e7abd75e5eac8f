// A session that goes on: after a kill, with frames that are to be taken again, on another sample.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/laser_bench.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using Command = SequencerCommand;

int Count(const Bench& bench, size_t from, std::string_view operation) {
  const auto operations = bench.log.operations();
  return static_cast<int>(std::count(operations.begin() + static_cast<std::ptrdiff_t>(from),
                                     operations.end(), operation));
}

TEST(Resume, TakesOnlyWhatIsMissing) {
  Bench bench;
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
  bench.session->Reopen();
  bench.session->Lose(1, 0);
  const size_t before = bench.log.operations().size();
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig), Command::kResume);
  EXPECT_TRUE(end.complete) << end.text;
  EXPECT_EQ(bench.session->records().size(), 6u);
  EXPECT_EQ(bench.session->records().back().shot, 1u);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kResumed), 1);
  EXPECT_EQ(bench.session->Journaled(JournalKind::kReference), 1);
  EXPECT_EQ(Count(bench, before, "turntable home"), 1) << "a kill may have moved it";
  EXPECT_EQ(Count(bench, before, "lamp 0"), 0) << "shot 0 is there: nothing is done for it";
  EXPECT_EQ(end.status.shots_done, 3u);
  bench.ExpectAtRest();
}

TEST(Resume, NothingMissingMovesNothing) {
  Bench bench;
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
  bench.session->Reopen();
  const size_t before = bench.log.operations().size();
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig), Command::kResume).complete);
  for (const auto* operation : {"turntable enable", "lamps open", "C0 open"}) {
    EXPECT_EQ(Count(bench, before, operation), 0) << operation;
  }
}

TEST(Resume, AnotherSampleIsRefusedUnlessAccepted) {
  Bench bench;
  EXPECT_TRUE(bench.Run(SmallPlan(bench.rig)).complete);
  bench.session->Reopen();
  bench.session->Lose(1, 0);
  bench.session->ReplaceReference(std::string(256, '\x03'));
  SequencerEvent end = bench.Run(SmallPlan(bench.rig), Command::kResume);
  EXPECT_FALSE(end.complete);
  EXPECT_THAT(end.text, HasSubstr("reference frame"));
  EXPECT_EQ(bench.session->records().size(), 5u) << "left as it was";
  bench.ExpectAtRest();
  bench.session->Reopen();
  bench.accept_reference = true;
  end = bench.Run(SmallPlan(bench.rig), Command::kResume);
  EXPECT_TRUE(end.complete) << end.text;
}

TEST(Resume, AsksForTheMountAgainBeforeTheFirstMissingSweep) {
  LaserBench bench;
  EXPECT_TRUE(bench.RunWithOperator(SmallLaserPlan(bench.rig)).complete);
  ASSERT_EQ(bench.prompts.size(), 2u);
  bench.prompts.clear();
  bench.session->Reopen();
  bench.session->Lose(12, 1);  // of the second mount
  bench.session->Expect(SmallLaserPlan(bench.rig));
  const SequencerEvent end = bench.RunWithOperator(SmallLaserPlan(bench.rig), Command::kResume);
  EXPECT_TRUE(end.complete) << end.text;
  ASSERT_EQ(bench.prompts.size(), 1u);
  EXPECT_EQ(bench.prompts[0].mount, "low");
  EXPECT_EQ(bench.session->records().size(), 33u);
}

// Damaged on the disk: found by the look at the end, and taken again.
TEST(Resume, DamagedFramesAreTakenAgain) {
  Bench bench;
  bench.session->Damage(0, 1);
  const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
  EXPECT_TRUE(end.complete) << end.text;
  EXPECT_EQ(bench.session->records().size(), 6u);
  EXPECT_EQ(bench.session->records().back().shot, 0u);
  EXPECT_EQ(end.status.shots_done, 3u);
}

// Stopped at every operation, then resumed: what was taken is not taken again.
TEST(Resume, GoesOnAfterAStopAtEveryPoint) {
  const int operations = OperationsOfSmallPlan();
  for (int at = 1; at < operations; ++at) {
    SCOPED_TRACE(at);
    Bench bench;
    bench.log.OnOperation([&](int index, const std::string&) {
      return index == at ? bench.sequencer->Stop("a hand said stop") : OkStatus();
    });
    if (bench.Run(SmallPlan(bench.rig)).complete) continue;
    bench.session->Reopen();
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig), Command::kResume);
    EXPECT_TRUE(end.complete) << end.text;
    EXPECT_EQ(bench.session->records().size(), 5u);
    bench.ExpectAtRest();
  }
}

}  // namespace
}  // namespace mesorig::daemon
