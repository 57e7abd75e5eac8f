// A disk that is full, read-only, failing or slow: the writer waits, tells why, and goes on.

#include <atomic>
#include <thread>

#include "daemon/session/verify.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/protocol/base/scripted_disk.h"

namespace mesorig::daemon {
namespace {

class DiskTrouble : public ::testing::Test {
 protected:
  std::shared_ptr<Session> Create(size_t max_queued_bytes = size_t{256} << 20) {
    auto session = Session::Create(folder_.path(), plan_, rig_,
                                   {.max_queued_bytes = max_queued_bytes, .faults = &disk_});
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  void ExpectWhole(const std::string& id) {
    const auto report = VerifySession(folder_.path(), id, nullptr);
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_EQ(report->summary.end, SessionEnd::kComplete);
    EXPECT_TRUE(report->imbalances.empty()) << report->imbalances.front().first;
    EXPECT_EQ(report->rows, plan_.frames);
  }

  TemporaryFolder folder_;
  ScriptedDisk disk_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SweepingPlan(rig_);
};

// Every kind of trouble, at segments and at the journal, at its first operation and in the middle:
// nothing is lost, nothing torn, and it says what, why and how much waits.
TEST_F(DiskTrouble, GoesOnWhenThereIsRoom) {
  for (const int error : {ENOSPC, EROFS, EIO, EBUSY}) {
    for (const char* part : {".seg", "journal.sqlite"}) {
      for (const uint64_t from : {0, 3, 11}) {
        SCOPED_TRACE(fmt::format("{} at {}, from {}", strerror(error), part, from));
        const auto session = Create();
        std::atomic<int> bad{0}, good{0};
        session->OnStorage([&](const Status& status) { ++(status.ok() ? good : bad); });
        disk_.FailFrom(from, error, part);
        ASSERT_TRUE(AppendAll(*session, plan_).ok());
        const Status full = session->Flush();
        ASSERT_TRUE(absl::IsUnavailable(full)) << full;
        const std::string text = session->Storage().ToString();
        EXPECT_NE(text.find(part), std::string::npos) << text;
        EXPECT_NE(text.find(" bytes wait in memory"), std::string::npos) << text;
        EXPECT_TRUE(absl::IsUnavailable(session->Finish(true, "", 1, 1, true)));
        EXPECT_EQ(session->Summary().end, SessionEnd::kOpen);
        EXPECT_GE(bad, 1);
        EXPECT_EQ(good, 0);
        disk_.Heal();
        ASSERT_TRUE(session->Flush().ok());
        EXPECT_TRUE(session->Storage().ok());
        EXPECT_EQ(good, 1);
        const Status finished = session->Finish(true, "", 1, 1, true);
        EXPECT_TRUE(finished.ok()) << finished;
        ExpectWhole(session->id());
      }
    }
  }
}

// While the disk takes nothing no more than the limit is kept, and nobody hangs: what is refused is
// missing and can be taken again.
TEST_F(DiskTrouble, KeepsNoMoreThanTheLimit) {
  const auto session = Create(1000);
  disk_.FailFrom(0, ENOSPC, ".seg");
  Status refused;
  std::vector<std::pair<int, uint32_t>> owed;
  for (uint32_t shot = 0; shot < 8; ++shot) {
    for (int camera = 0; camera < 8; ++camera) {
      const Status status = session->Append(FrameOf(camera, shot), PixelsOf(camera, shot));
      if (status.ok()) continue;
      refused = status;
      owed.emplace_back(camera, shot);
    }
  }
  ASSERT_TRUE(absl::IsResourceExhausted(refused)) << refused;
  EXPECT_EQ(owed.size(), 64u - 7);
  EXPECT_EQ(session->Missing(7).size(), 8u);
  disk_.Heal();
  ASSERT_TRUE(session->Flush().ok());
  for (const auto& [camera, shot] : owed) {
    ASSERT_TRUE(session->Append(FrameOf(camera, shot), PixelsOf(camera, shot)).ok());
  }
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kSweep) {
      ASSERT_TRUE(AppendSweep(*session, step).ok());
    }
  }
  const Status finished = session->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
  ExpectWhole(session->id());
}

// A stop while the disk takes nothing ends all the same; a resume takes what was not durable.
TEST_F(DiskTrouble, AStopIsNotHeldUp) {
  std::string id;
  {
    const auto session = Create();
    id = session->id();
    disk_.FailFrom(0, ENOSPC);
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kShot) {
        ASSERT_TRUE(AppendShot(*session, step).ok());
      }
    }
    EXPECT_TRUE(absl::IsUnavailable(session->Finish(false, "stopped", 1, 1, true)));
    EXPECT_EQ(session->Summary().end, SessionEnd::kIncomplete);
    disk_.Heal();
  }
  const auto session = Session::Resume(folder_.path(), id, rig_);
  ASSERT_TRUE(session.ok()) << session.status();
  EXPECT_EQ((*session)->Missing(0).size(), 8u);
  ASSERT_TRUE(AppendAll(**session, plan_).ok());
  const Status finished = (*session)->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
  ExpectWhole(id);
}

// A slow disk holds Append up beyond the limit only, and readers not at all.
TEST_F(DiskTrouble, ASlowDiskLosesNothing) {
  Mutex mutex;
  CondVar changed;
  bool is_stuck = false;
  const auto session = Create(1000);
  disk_.OnAccess([&](const DiskAccess&) {
    MutexLock lock(mutex);
    while (is_stuck) changed.Wait(mutex);
  });
  ASSERT_TRUE(session->Append(FrameOf(0, 0), PixelsOf(0, 0)).ok());
  ASSERT_TRUE(session->Flush().ok());
  {
    MutexLock lock(mutex);
    is_stuck = true;
  }
  std::atomic<bool> done{false};
  std::thread rig([&] {
    for (int camera = 1; camera < 8; ++camera) {
      EXPECT_TRUE(session->Append(FrameOf(camera, 0), PixelsOf(camera, 0)).ok());
    }
    for (uint32_t shot = 1; shot < 8; ++shot) {
      for (int camera = 0; camera < 8; ++camera) {
        EXPECT_TRUE(session->Append(FrameOf(camera, shot), PixelsOf(camera, shot)).ok());
      }
    }
    done = true;
  });
  const auto frame = session->Next(0, 0, 0);
  EXPECT_TRUE(frame.ok() && frame->has_value());
  EXPECT_FALSE(done) << "more than the limit is not taken";
  {
    MutexLock lock(mutex);
    is_stuck = false;
    changed.NotifyAll();
  }
  rig.join();
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kSweep) {
      ASSERT_TRUE(AppendSweep(*session, step).ok());
    }
  }
  const Status finished = session->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
  ExpectWhole(session->id());
}

}  // namespace
}  // namespace mesorig::daemon
