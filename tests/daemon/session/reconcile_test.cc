#include "daemon/session/reconcile.h"

#include <fstream>

#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

class ReconcileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    session_ = *session;
  }
  // Finishes as complete, and checks that the end on disk tells what the status tells.
  Status Finish() {
    const Status status = session_->Finish(true, "", 1, 1, true);
    const SessionSummary now = session_->Summary();
    const std::string id = session_->id();
    session_.reset();
    const SessionSummary then = (*Session::Open(folder_.path(), id))->Summary();
    for (const SessionSummary& s : {now, then}) {
      EXPECT_EQ(s.end, status.ok() ? SessionEnd::kComplete : SessionEnd::kIncomplete);
      EXPECT_EQ(s.reason, status.ok() ? "" : Message(status));
    }
    return status;
  }
  static bool Says(const Status& status, std::string_view text) {
    return absl::IsDataLoss(status) && Message(status).find(text) != std::string::npos;
  }
  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SmallPlan(rig_);
  std::shared_ptr<Session> session_;
};

TEST_F(ReconcileTest, AMissingFrameIsNamed) {
  for (uint32_t shot = 0; shot < 8; ++shot) {
    for (int camera = 0; camera < 8; ++camera) {
      if (shot == 5 && camera == 3) continue;
      ASSERT_TRUE(session_->Append(FrameOf(camera, shot), PixelsOf(camera, shot)).ok());
    }
  }
  const Status status = Finish();
  EXPECT_TRUE(Says(status, "of 64 planned frames 1 are missing (first: shot 5, camera cam3)"))
      << status;
}

// The later frame supersedes the earlier one, whether or not that is durable yet.
TEST_F(ReconcileTest, ARetakenFrameCountsOnce) {
  ASSERT_TRUE(AppendAll(*session_, plan_).ok());
  FrameRecord again = FrameOf(4, 2);
  again.trigger_id = 900;
  ASSERT_TRUE(session_->Append(again, PixelsOf(4, 2)).ok());
  ASSERT_TRUE(session_->Flush().ok());
  ++again.trigger_id;
  ASSERT_TRUE(session_->Append(again, PixelsOf(4, 2)).ok());
  ASSERT_TRUE(session_->Flush().ok());
  EXPECT_EQ((*session_->Next(4, 8, 0))->record.supersedes, 3u) << "shot 2 is the third row";
  EXPECT_EQ((*session_->Next(4, 9, 0))->record.supersedes, 9u);
  EXPECT_TRUE(Finish().ok());
}

TEST_F(ReconcileTest, UnplannedShotsSharedTriggersAndWrongSizesAreRefused) {
  ASSERT_TRUE(AppendAll(*session_, plan_).ok());
  ASSERT_TRUE(session_->Append(FrameOf(1, 8), PixelsOf(1, 8)).ok());
  FrameRecord shared = FrameOf(2, 1);
  shared.trigger_id = 1;  // of shot 0
  shared.width = 4;
  shared.height = 16;
  ASSERT_TRUE(session_->Append(shared, PixelsOf(2, 1)).ok());
  const Status status = Finish();
  EXPECT_TRUE(Says(status, "1 rows that were not planned (first: frame 9 of camera 1, shot 8)"))
      << status;
  EXPECT_TRUE(Says(status, "1 triggers of two shots (first: trigger 1)")) << status;
  EXPECT_TRUE(Says(status, "4 x 16, 12 bits")) << status;
}

TEST_F(ReconcileTest, WhatTheDiskLostIsFound) {
  ASSERT_TRUE(AppendAll(*session_, plan_).ok());
  ASSERT_TRUE(session_->Flush().ok());
  const auto segment = folder_.path() / session_->id() / "cam6.seg";
  std::fstream file(segment, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(-1, std::ios::end);  // the last pixel of shot 7
  file.put(static_cast<char>(~PixelsOf(6, 7)->back()));
  file.close();
  const Status status = Finish();
  EXPECT_TRUE(Says(status, "1 frames are damaged")) << status;
  EXPECT_TRUE(Says(status, "cam6.seg: frame 8 (shot 7")) << status;
}

TEST_F(ReconcileTest, AnIncompleteEndKeepsItsReason) {
  ASSERT_TRUE(session_->Append(FrameOf(0, 0), PixelsOf(0, 0)).ok());
  ASSERT_TRUE(session_->Finish(false, "stopped by a person", 3, 4, false).ok());
  const SessionSummary s = session_->Summary();
  EXPECT_EQ(s.end, SessionEnd::kIncomplete);
  EXPECT_EQ(s.reason, "stopped by a person");
  EXPECT_FALSE(s.deterministic);
  EXPECT_EQ(s.frames_durable, 1u);
}

class ReconcileSweeps : public ReconcileTest {
 protected:
  void SetUp() override {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    session_ = *session;
  }
  const Step& LastSweep() const { return plan_.steps.back(); }  // shots 16..19, all cameras
  // Everything but frame `index` of camera 5 in the last sweep.
  void AppendAllBut(uint32_t missing) {
    CompiledPlan others = plan_;
    others.steps.pop_back();
    ASSERT_TRUE(AppendAll(*session_, others).ok());
    for (uint32_t index = 0; index < 4; ++index) {
      for (size_t k = 0; k < 8; ++k) {
        if (k == 5 && index == missing) continue;
        ASSERT_TRUE(AppendSweepFrame(*session_, SweepFrameOf(LastSweep(), k, index)).ok());
      }
    }
  }
  const CompiledPlan plan_ = SweepingPlan(rig_);
};

TEST_F(ReconcileSweeps, ReleasedSweepsStandByTheirRows) {
  ASSERT_TRUE(AppendAll(*session_, plan_).ok());
  ASSERT_TRUE(session_->Flush().ok());
  ASSERT_TRUE(session_->ReleaseSweep(1).ok());
  ASSERT_TRUE(session_->ReleaseSweep(2).ok());
  const Status status = Finish();
  EXPECT_TRUE(status.ok()) << status;
}

TEST_F(ReconcileSweeps, AMissingFrameIsNamedBesideReleasedSweeps) {
  AppendAllBut(2);
  ASSERT_TRUE(session_->Flush().ok());
  ASSERT_TRUE(session_->ReleaseSweep(1).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(session_->ReleaseSweep(2).status()));
  const Status status = Finish();
  EXPECT_TRUE(Says(status, "of 117 planned frames 1 are missing (first: shot 18, camera cam5)"))
      << status;
}

TEST_F(ReconcileSweeps, WhatTheDiskLostOfASweepIsFound) {
  ASSERT_TRUE(AppendAll(*session_, plan_).ok());
  ASSERT_TRUE(session_->Flush().ok());
  std::filesystem::remove(folder_.path() / session_->id() / "sweeps/00001.cam6.seg");
  const Status status = Finish();
  EXPECT_TRUE(Says(status, "5 frames are damaged")) << status;
  EXPECT_TRUE(Says(status, "00001.cam6.seg")) << status;
}

TEST_F(ReconcileSweeps, RegionsAndPlacesInTheSweepAreThePlans) {
  AppendAllBut(3);
  FrameRecord frame = SweepFrameOf(LastSweep(), 5, 3);
  frame.region_x = 0;
  frame.laser->index = 2;
  ASSERT_TRUE(AppendSweepFrame(*session_, frame).ok());
  const Status status = Finish();
  EXPECT_TRUE(Says(status,
                   "1 frames of another size (first: frame 12 of camera 5, shot 19: 6 x "
                   "4, 12 bits, at (0, 4))"))
      << status;
  EXPECT_TRUE(Says(status,
                   "1 frames with another laser state (first: frame 12 of camera 5, shot "
                   "19: frame 2 of sweep 2, mount 0)"))
      << status;
}

TEST_F(ReconcileSweeps, ASweepsFrameHasALaserAndAGridsHasNone) {
  AppendAllBut(3);
  FrameRecord without = SweepFrameOf(LastSweep(), 5, 3);
  without.laser.reset();
  ASSERT_TRUE(AppendSweepFrame(*session_, without).ok());
  FrameRecord with = FrameOf(2, 1);
  with.supersedes = 2;
  with.trigger_id = 900;
  with.laser = LaserRecord{};
  ASSERT_TRUE(session_->Append(with, PixelsOf(2, 1)).ok());
  const Status status = Finish();
  EXPECT_TRUE(Says(status,
                   "2 frames with another laser state (first: frame 13 of camera 2, shot "
                   "1: frame 0 of sweep 0, mount 0)"))
      << status;
}

}  // namespace
}  // namespace mesorig::daemon
