// A session that was killed, or ended incomplete, is written on.

#include <fstream>

#include "daemon/session/live_frames.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

class ResumeTest : public SessionTest {
 protected:
  std::shared_ptr<Session> Resume() {
    auto session = Session::Resume(folder_.path(), id_, rig_);
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  const Step& ShotStep(uint32_t shot) const {
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kShot && step.shot == shot) return step;
    }
    ADD_FAILURE() << shot;
    return plan_.steps.front();
  }
  // The first `shots` shots, and the end left open.
  void Begin(uint32_t shots) {
    const auto session = Create();
    for (uint32_t shot = 0; shot < shots; ++shot) {
      ASSERT_TRUE(AppendShot(*session, ShotStep(shot)).ok());
    }
  }

  const std::vector<int> all_ = {0, 1, 2, 3, 4, 5, 6, 7};
};

// What is missing is shot, and a consumer that follows gets every row once, in order.
TEST_F(ResumeTest, GoesOnWithWhatIsMissing) {
  Begin(3);
  std::vector<uint64_t> seen;
  {
    const auto before = Session::Open(folder_.path(), id_);
    ASSERT_TRUE(before.ok());
    for (const FrameRecord& r : ReadAll(**before, 5, 3).good) seen.push_back(r.sequence);
    EXPECT_TRUE((*before)->Missing(0).empty()) << "only read";
  }
  const auto session = Resume();
  EXPECT_EQ(session->Summary().starts, 2u);
  EXPECT_EQ(session->Summary().frames_durable, 24u);
  for (uint32_t shot = 0; shot < 3; ++shot) EXPECT_TRUE(session->Missing(shot).empty());
  for (uint32_t shot = 3; shot < 8; ++shot) {
    EXPECT_EQ(session->Missing(shot), all_);
    ASSERT_TRUE(AppendShot(*session, ShotStep(shot)).ok());
    EXPECT_TRUE(session->Missing(shot).empty());
  }
  EXPECT_EQ(session->Missing(9), (std::vector<int>{1, 3}));
  EXPECT_TRUE(session->Missing(20).empty()) << "not planned";
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kSweep) {
      ASSERT_TRUE(AppendSweep(*session, step).ok());
    }
  }
  const Status finished = session->Finish(true, "", 1, 1, true);
  ASSERT_TRUE(finished.ok()) << finished;
  const Replay replay = ReadAll(*session, 5, 13);
  EXPECT_TRUE(replay.bad.empty());
  ASSERT_EQ(replay.good.size(), 12u);  // 8 lamp shots, 4 of the last sweep
  for (size_t i = 0; i < replay.good.size(); ++i) {
    EXPECT_EQ(replay.good[i].sequence, i + 1);
    EXPECT_EQ(replay.good[i].run, i < 3 ? 0u : 1u);
  }
  EXPECT_EQ(seen, (std::vector<uint64_t>{1, 2, 3}));
}

TEST_F(ResumeTest, RefusesWhatItShouldNotTouch) {
  Begin(1);
  Rig other = rig_;
  other.sha256[0] = other.sha256[0] == '0' ? '1' : '0';
  const Status rig = Session::Resume(folder_.path(), id_, other).status();
  EXPECT_TRUE(absl::IsInvalidArgument(rig)) << rig;
  EXPECT_TRUE(absl::IsNotFound(Session::Resume(folder_.path(), "nothing", rig_).status()));
  {
    const auto session = Resume();
    const Status twice = Session::Resume(folder_.path(), id_, rig_).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(twice)) << twice;
    ASSERT_TRUE(session->Finish(false, "stopped: coffee", 2, 3, true).ok());
  }
  {
    const auto session = Resume();
    EXPECT_EQ(session->Summary().end, SessionEnd::kOpen);
    EXPECT_EQ(session->Summary().reason, "");
    ASSERT_TRUE(session->Finish(false, "again", 5, 7, true).ok());
    EXPECT_EQ(session->Summary().virtual_s, 7);
    EXPECT_EQ(session->Summary().wall_s, 10);
    EXPECT_EQ(session->Summary().starts, 3u);
  }
  const auto complete = Create();
  ASSERT_TRUE(AppendAll(*complete, plan_).ok());
  ASSERT_TRUE(complete->Finish(true, "", 1, 1, true).ok());
  const Status ended = Session::Resume(folder_.path(), id_, rig_).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(ended)) << ended;
}

TEST_F(ResumeTest, RefusesAnotherPlanAndALedgerWithGaps) {
  Begin(1);
  const std::string whole = *ReadFile(File("plan.bin"));
  std::ofstream(File("plan.bin"), std::ios::binary) << PackPlan(SmallPlan(rig_));
  const Status plan = Session::Resume(folder_.path(), id_, rig_).status();
  EXPECT_TRUE(absl::IsDataLoss(plan)) << plan;
  std::ofstream(File("plan.bin"), std::ios::binary) << whole;
  EXPECT_TRUE(Session::Resume(folder_.path(), id_, rig_).ok());
}

// Whatever lies behind the last row is cut off, and what rows speak of is not touched.
TEST_F(ResumeTest, CutsTornTails) {
  Begin(2);
  const std::string before = *ReadFile(File("cam3.seg"));
  std::ofstream(File("cam3.seg"), std::ios::binary | std::ios::app) << "half of a record";
  std::filesystem::create_directories(File("sweeps"));
  std::ofstream(File("sweeps/00001.cam3.seg"), std::ios::binary) << "of a sweep without a row";
  const auto session = Resume();
  EXPECT_EQ(*ReadFile(File("cam3.seg")), before);
  for (uint32_t shot = 2; shot < 8; ++shot) {
    ASSERT_TRUE(AppendShot(*session, ShotStep(shot)).ok());
  }
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kSweep) {
      ASSERT_TRUE(AppendSweep(*session, step).ok());
    }
  }
  const Status finished = session->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
  EXPECT_TRUE(ReadFile(File("cam3.seg"))->starts_with(before));
}

// A segment that is lost or too short: its frames are damaged, and new ones go behind them.
TEST_F(ResumeTest, DamagedFramesAreShotAgainAndReconcile) {
  Begin(4);
  std::filesystem::remove(File("cam2.seg"));
  std::filesystem::resize_file(File("cam5.seg"), std::filesystem::file_size(File("cam5.seg")) - 1);
  {
    std::fstream file(File("cam6.seg"), std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(-200 * 3, std::ios::end);  // the header of the second record
    file << "x";
  }
  const auto session = Resume();
  for (uint32_t shot = 4; shot < 8; ++shot) {
    ASSERT_TRUE(AppendShot(*session, ShotStep(shot)).ok());
  }
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kSweep) {
      ASSERT_TRUE(AppendSweep(*session, step).ok());
    }
  }
  const auto dropped = session->DropDamaged();
  ASSERT_TRUE(dropped.ok()) << dropped.status();
  EXPECT_EQ(*dropped, 4u + 1 + 1);
  EXPECT_EQ(*session->DropDamaged(), 0u) << "they are known";
  EXPECT_EQ(session->Missing(0), std::vector<int>{2});
  EXPECT_EQ(session->Missing(1), (std::vector<int>{2, 6}));
  EXPECT_EQ(session->Missing(3), (std::vector<int>{2, 5}));
  for (uint32_t shot = 0; shot < 8; ++shot) {
    for (const int camera : session->Missing(shot)) {
      FrameRecord again = FrameOf(camera, shot);
      again.trigger_id += 1000;
      ASSERT_TRUE(session->Append(again, PixelsOf(camera, shot)).ok());
    }
    EXPECT_TRUE(session->Missing(shot).empty());
  }
  const Status finished = session->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
}

// Frames that somebody wants again are missing in this run, and the old ones count after a kill.
TEST_F(ResumeTest, ForgottenFramesAreSuperseded) {
  Begin(2);
  const auto resume = [&](uint32_t shot, std::vector<int> cameras) {
    SessionOptions options;
    options.again = {{shot, std::move(cameras)}};
    return Session::Resume(folder_.path(), id_, rig_, options);
  };
  EXPECT_TRUE(absl::IsInvalidArgument(resume(20, {0}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(resume(1, {8}).status()));
  EXPECT_EQ(resume(1, {0, 4}).value()->Missing(1), (std::vector<int>{0, 4}));
  EXPECT_TRUE(Resume()->Missing(1).empty());
  const auto session = resume(1, {4}).value();
  ASSERT_TRUE(session->Append(FrameOf(4, 1), PixelsOf(4, 1)).ok());
  ASSERT_TRUE(session->Flush().ok());
  EXPECT_EQ((*session->Next(4, 2, 0))->record.supersedes, 2u);
}

// A run that takes frames of a complete session again, and fails, has lost nothing.
TEST_F(ResumeTest, ACompleteSessionStaysComplete) {
  {
    const auto session = Create();
    ASSERT_TRUE(AppendAll(*session, plan_).ok());
    ASSERT_TRUE(session->Finish(true, "", 1, 1, true).ok());
  }
  EXPECT_TRUE(absl::IsFailedPrecondition(
      Session::Resume(folder_.path(), id_, rig_).status()));
  SessionOptions options;
  options.again = {{2, {0, 1}}};
  {
    const auto session = Session::Resume(folder_.path(), id_, rig_, options).value();
    EXPECT_EQ(session->Missing(2), (std::vector<int>{0, 1}));
    ASSERT_TRUE(session->Append(FrameOf(1, 2), PixelsOf(1, 2)).ok());
    EXPECT_TRUE(session->Finish(false, "the lamp broke", 1, 1, true).ok());
  }
  const SessionSummary summary = Session::Open(folder_.path(), id_).value()->Summary();
  EXPECT_EQ(summary.end, SessionEnd::kComplete) << summary.reason;
  EXPECT_EQ(summary.frames_durable, plan_.frames + 1);
}

TEST_F(ResumeTest, EntriesAndMeteredExposuresSurvive) {
  {
    const auto session = Create();
    ASSERT_TRUE(session->Record({JournalKind::kBegan, 1, -1, 0, ""}).ok());
    ASSERT_TRUE(session->Record({JournalKind::kExposure, 2, 3, 0.04, ""}).ok());
    ASSERT_TRUE(session->Record({JournalKind::kExposure, 3, 3, 0.02, ""}).ok());
    EXPECT_EQ(session->MeteredExposure(3), 0.02);
    const Status nan = session->Record({JournalKind::kNote, 4, 0, std::nan(""), ""});
    EXPECT_TRUE(absl::IsInvalidArgument(nan)) << nan;
  }
  const auto session = Resume();
  EXPECT_EQ(session->MeteredExposure(3), 0.02);
  EXPECT_EQ(session->MeteredExposure(0), std::nullopt);
  ASSERT_TRUE(session->Record({JournalKind::kResumed, 0, -1, 0, "after a \"kill\""}).ok());
  ASSERT_TRUE(session->Flush().ok());
  const auto entries = session->Entries();
  ASSERT_TRUE(entries.ok()) << entries.status();
  ASSERT_EQ(entries->size(), 4u);
  EXPECT_EQ((*entries)[1].index, 3);
  EXPECT_EQ((*entries)[1].value, 0.04);
  EXPECT_EQ((*entries)[3].kind, JournalKind::kResumed);
  EXPECT_EQ((*entries)[3].text, "after a \"kill\"");
}

// The last lamp frame that is whole: not a sweep's, not a damaged one, and durable.
TEST_F(ResumeTest, TheReferenceIsTheLastWholeLampFrame) {
  Begin(0);
  {
    const auto session = Resume();
    const auto none = session->Reference();
    ASSERT_TRUE(none.ok()) << none.status();
    EXPECT_FALSE(none->has_value());
    for (uint32_t shot = 0; shot < 3; ++shot) {
      ASSERT_TRUE(AppendShot(*session, ShotStep(shot)).ok());
    }
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kSweep) {
        ASSERT_TRUE(AppendSweep(*session, step).ok());
      }
    }
  }
  std::filesystem::resize_file(File("cam0.seg"), std::filesystem::file_size(File("cam0.seg")) - 1);
  const auto session = Resume();
  const auto reference = session->Reference();
  ASSERT_TRUE(reference.ok()) << reference.status();
  ASSERT_TRUE(reference->has_value());
  EXPECT_EQ((*reference)->record.shot, 2u);
  EXPECT_EQ((*reference)->record.camera, 1);
  EXPECT_EQ(*(*reference)->pixels, *PixelsOf(1, 2));
}

TEST_F(ResumeTest, TheNewestFrameIsThereBeforeItIsDurable) {
  const auto session = Create();
  EXPECT_FALSE(session->Latest(2, 0, 0).has_value());
  EXPECT_FALSE(session->Latest(99, 0, 0).has_value());
  for (uint32_t shot = 0; shot < 3; ++shot) {
    ASSERT_TRUE(session->Append(FrameOf(2, shot), PixelsOf(2, shot)).ok());
  }
  const auto latest = session->Latest(2, 0, 0);
  ASSERT_TRUE(latest.has_value());
  EXPECT_EQ(latest->count, 3u);
  EXPECT_EQ(latest->frame.record.shot, 2u);
  EXPECT_FALSE(session->Latest(2, 3, 0).has_value());
}

}  // namespace
}  // namespace mesorig::daemon
