#include "daemon/session/session.h"

#include <fcntl.h>
#include <sys/wait.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "protocol/base/digest.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

class SessionTest : public ::testing::Test {
 protected:
  std::shared_ptr<Session> Create(SessionOptions options = {}) {
    auto session = Session::Create(folder_.path(), plan_, rig_, options);
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SmallPlan(rig_, 2);
};

TEST_F(SessionTest, KeepsWhatWasAppended) {
  std::string id;
  {
    const auto session = Create();
    id = session->id();
    EXPECT_EQ(session->Summary().end, SessionEnd::kOpen);
    ASSERT_TRUE(AppendAll(*session, plan_).ok());
    const Status finished = session->Finish(true, "", 12.5, 0.75, true);
    ASSERT_TRUE(finished.ok()) << finished;
    EXPECT_TRUE(absl::IsFailedPrecondition(session->Append(FrameOf(0, 0), PixelsOf(0, 0))));
  }
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / id / "journal.sqlite-wal"));
  const auto session = Session::Open(folder_.path(), id);
  ASSERT_TRUE(session.ok()) << session.status();
  const SessionSummary summary = (*session)->Summary();
  EXPECT_EQ(summary.end, SessionEnd::kComplete);
  EXPECT_EQ(summary.plan_name, "small");
  EXPECT_EQ(summary.rig_sha256, rig_.sha256);
  EXPECT_EQ(summary.plan_sha256, Sha256(PackPlan(plan_)));
  EXPECT_EQ(summary.virtual_s, 12.5);
  EXPECT_EQ(summary.wall_s, 0.75);
  EXPECT_TRUE(summary.deterministic);
  EXPECT_EQ(summary.frames_planned, 128u);
  EXPECT_EQ(summary.frames_durable, 128u);
  EXPECT_EQ((*session)->rig_toml(), rig_.source_text);
  EXPECT_EQ((*session)->plan_bin(), PackPlan(plan_));
  for (int camera = 0; camera < 8; ++camera) {
    const Replay replay = ReadAll(**session, camera, 17);
    ASSERT_EQ(replay.good.size(), 16u);
    EXPECT_TRUE(replay.bad.empty());
    for (uint32_t i = 0; i < 16; ++i) {
      const FrameRecord& got = replay.good[i];
      const FrameRecord sent = FrameOf(camera, i);
      EXPECT_EQ(got.sequence, i + 1);
      EXPECT_EQ(got.shot, i);
      EXPECT_EQ(got.trigger_id, sent.trigger_id);
      EXPECT_EQ(got.frame_id, sent.frame_id);
      EXPECT_EQ(got.exposure_start_ns, sent.exposure_start_ns);
      EXPECT_EQ(got.exposure_end_ns, sent.exposure_end_ns);
      EXPECT_EQ(got.axis_rad, sent.axis_rad);
      EXPECT_EQ(got.lamp_level, sent.lamp_level);
      EXPECT_EQ(got.digest, FrameDigest(*PixelsOf(camera, i)));
    }
  }
}

TEST_F(SessionTest, IdsSortByAgeAndListOnlySessions) {
  EXPECT_TRUE(ListSessions(folder_.path() / "none")->empty());
  std::vector<std::string> ids;
  for (int i = 0; i < 5; ++i) ids.push_back(Create()->id());
  std::filesystem::create_directory(folder_.path() / "holiday pictures");
  std::filesystem::create_directory(folder_.path() / ".20260101T000000.000Z-x.part");
  EXPECT_EQ(*ListSessions(folder_.path()), ids);
  const CompiledPlan odd = SmallPlan(rig_, 1, "../ a/b");
  const auto session = Session::Create(folder_.path(), odd, rig_);
  ASSERT_TRUE(session.ok());
  EXPECT_TRUE((*session)->id().ends_with("Z-..--a-b")) << (*session)->id();
}

TEST_F(SessionTest, UnknownIdsAreNotFoundAndNeverPaths) {
  const std::string id = Create()->id();
  for (const std::string& bad : {std::string("nothing"), std::string(), "./" + id, id + "/",
                                 "../" + folder_.path().filename().string() + "/" + id}) {
    EXPECT_TRUE(absl::IsNotFound(Session::Open(folder_.path(), bad).status())) << bad;
  }
}

TEST_F(SessionTest, RefusesFramesThatCannotBe) {
  const auto session = Create();
  EXPECT_TRUE(absl::IsInvalidArgument(session->Append(FrameOf(8, 0), PixelsOf(0, 0))));
  EXPECT_TRUE(absl::IsInvalidArgument(session->Append(FrameOf(-1, 0), PixelsOf(0, 0))));
  EXPECT_TRUE(absl::IsInvalidArgument(session->Append(FrameOf(0, 0), PixelsOf(0, 0, 127))));
  EXPECT_TRUE(absl::IsInvalidArgument(session->Append(FrameOf(0, 0), nullptr)));
  EXPECT_TRUE(absl::IsInvalidArgument(session->Next(8, 0, 0).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(session->Next(-1, 0, 0).status()));
}

// Several consumers a camera, each with its own cursor, while frames are appended: everyone sees
// every frame once, in order, and nothing before it is durable.
TEST_F(SessionTest, ConsumersSeeEveryFrameOnceInOrder) {
  const auto session = Create();
  std::atomic<uint32_t> durable{0};
  session->OnDurable([&](uint32_t frames) { durable = frames; });
  std::atomic<int> wrong{0};
  std::vector<std::thread> consumers;
  for (int i = 0; i < 16; ++i) {
    consumers.emplace_back([&, camera = i % 8] {
      uint64_t cursor = 0;
      const bool followed = FollowToEnd(*session, camera, [&](const StoredFrame& frame) {
        const FrameRecord& r = frame.record;
        if (r.sequence != cursor + 1 || r.shot != cursor || r.camera != camera) ++wrong;
        if (*frame.pixels != *PixelsOf(camera, r.shot)) ++wrong;
        if (session->Summary().frames_durable < r.sequence) ++wrong;
        cursor = r.sequence;
      });
      if (!followed) ++wrong;
      if (cursor != 16) ++wrong;
    });
  }
  ASSERT_TRUE(AppendAll(*session, plan_).ok());
  ASSERT_TRUE(session->Finish(true, "", 1, 1, true).ok());
  for (auto& consumer : consumers) consumer.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(durable, 128u);
}

TEST_F(SessionTest, BecomesDurableWithoutBeingAsked) {
  const auto session = Create();
  ASSERT_TRUE(session->Append(FrameOf(2, 0), PixelsOf(2, 0)).ok());
  const auto began = std::chrono::steady_clock::now();
  const auto frame = session->Next(2, 0, 20000);
  ASSERT_TRUE(frame.ok() && frame->has_value());
  RecordProperty("durable_after_us", static_cast<int>((std::chrono::steady_clock::now() - began) /
                                                      std::chrono::microseconds(1)));
  EXPECT_FALSE((*session->Next(2, 1, 0)).has_value());
  EXPECT_FALSE((*session->Next(3, 0, 0)).has_value());
}

// A process that dies at once after Flush: what was flushed is there, the end is open.
TEST_F(SessionTest, AKillLosesNothingThatWasAcknowledged) {
  const pid_t child = ::fork();
  if (child == 0) {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    if (!session.ok() || !AppendShot(**session, plan_.steps[2]).ok()) ::_exit(2);
    if (!(*session)->Flush().ok()) ::_exit(3);
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kShot && step.shot > 0) (void)AppendShot(**session, step);
    }
    ::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status)) << "child failed with " << WEXITSTATUS(status);
  const auto ids = ListSessions(folder_.path());
  ASSERT_EQ(ids->size(), 1u);
  const auto session = Session::Open(folder_.path(), ids->front());
  ASSERT_TRUE(session.ok()) << session.status();
  EXPECT_EQ((*session)->Summary().end, SessionEnd::kOpen);
  EXPECT_GE((*session)->Summary().frames_durable, 8u);
  for (int camera = 0; camera < 8; ++camera) {
    const Replay replay = ReadAll(**session, camera, 16);
    ASSERT_GE(replay.good.size(), 1u);
    EXPECT_EQ(replay.good[0].shot, 0u);
    EXPECT_TRUE(replay.bad.empty());
  }
  EXPECT_TRUE(absl::IsFailedPrecondition((*session)->Append(FrameOf(0, 0), PixelsOf(0, 0))));
  EXPECT_TRUE(absl::IsFailedPrecondition((*session)->Finish(true, "", 0, 0, true)));
}

TEST_F(SessionTest, CameraNamesMustBeFileNames) {
  Rig rig = rig_;
  rig.cameras[3].name = "../cam";
  const auto session = Session::Create(folder_.path(), plan_, rig);
  ASSERT_TRUE(absl::IsInvalidArgument(session.status())) << session.status();
  EXPECT_NE(Message(session.status()).find("../cam"), std::string::npos);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path())) << "nothing half-written";
}

}  // namespace
}  // namespace mesorig::daemon
