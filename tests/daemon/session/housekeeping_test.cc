#include "daemon/session/housekeeping.h"

#include <fstream>

#include "daemon/session/verify.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

class Housekeeping : public ::testing::Test {
 protected:
  std::shared_ptr<Session> Create() {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  std::string CreateComplete() {
    const auto session = Create();
    EXPECT_TRUE(AppendAll(*session, plan_).ok());
    EXPECT_TRUE(session->Finish(true, "", 1, 1, true).ok());
    return session->id();
  }
  SessionState StateOf(const std::string& id) {
    const auto info = DescribeSession(folder_.path(), id);
    EXPECT_TRUE(info.ok()) << info.status();
    return info->state;
  }
  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SmallPlan(rig_);
};

TEST_F(Housekeeping, TellsWhatASessionIs) {
  const std::string complete = CreateComplete();
  const auto info = DescribeSession(folder_.path(), complete);
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->state, SessionState::kComplete);
  EXPECT_EQ(info->frames_durable, 64u);
  EXPECT_EQ(info->frames_planned, 64u);
  EXPECT_GT(info->bytes, 64u * 200);
  EXPECT_GE(info->age_s, 0);
  EXPECT_EQ(info->plan_name, "small");
  EXPECT_EQ(info->sample_name, "s");
  std::string id;
  {
    const auto session = Create();
    id = session->id();
    EXPECT_EQ(StateOf(id), SessionState::kLive);
    const Status removed = RemoveSession(folder_.path(), id).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(removed)) << removed;
  }
  EXPECT_EQ(StateOf(id), SessionState::kKilled);
  {
    auto session = Session::Resume(folder_.path(), id, rig_);
    ASSERT_TRUE(session.ok());
    EXPECT_EQ(StateOf(id), SessionState::kLive);
    ASSERT_TRUE((*session)->Finish(false, "stopped: rain", 1, 1, true).ok());
  }
  EXPECT_EQ(StateOf(id), SessionState::kIncomplete);
  std::ofstream(folder_.path() / id / "journal.sqlite", std::ios::trunc) << "rain";
  EXPECT_EQ(StateOf(id), SessionState::kDamaged);
  EXPECT_TRUE(absl::IsNotFound(DescribeSession(folder_.path(), "../x").status()));
  EXPECT_TRUE(absl::IsNotFound(RemoveSession(folder_.path(), "nothing").status()));
  ASSERT_TRUE(RemoveSession(folder_.path(), id).ok()) << "somebody has to be able to";
  EXPECT_EQ(*ListSessions(folder_.path()), std::vector<std::string>{complete});
}

TEST_F(Housekeeping, CleansByTheRule) {
  const auto session = [](std::string id, SessionState state, double age_s) {
    SessionInfo info;
    info.id = std::move(id);
    info.state = state;
    info.age_s = age_s;
    return info;
  };
  const std::vector<SessionInfo> all = {
      session("a", SessionState::kComplete, 900), session("b", SessionState::kKilled, 800),
      session("c", SessionState::kComplete, 700), session("d", SessionState::kIncomplete, 600),
      session("e", SessionState::kDamaged, 500),  session("f", SessionState::kComplete, 400),
      session("g", SessionState::kLive, 300)};
  using Ids = std::vector<std::string>;
  EXPECT_EQ(SessionsToRemove(all, {}), Ids{});
  EXPECT_EQ(SessionsToRemove(all, {1, {}, false}), (Ids{"a", "c"}));
  EXPECT_EQ(SessionsToRemove(all, {0, {}, false}), (Ids{"a", "c", "f"}));
  EXPECT_EQ(SessionsToRemove(all, {2, {}, true}), (Ids{"a", "b", "c"}));
  EXPECT_EQ(SessionsToRemove(all, {{}, 650, false}), (Ids{"a", "c"}));
  EXPECT_EQ(SessionsToRemove(all, {2, 650, false}), Ids{"a"});
}

TEST_F(Housekeeping, RemovesWhatWasLeftUnfinishedAndNothingElse) {
  EXPECT_EQ(*RemoveUnfinished(folder_.path() / "none"), 0u);
  const std::string id = CreateComplete();
  for (const char* name : {".20260101T000000.000Z-x.part", "x.part", ".hidden", ".a b.part"}) {
    std::filesystem::create_directories(folder_.path() / name / "inside");
  }
  std::ofstream(folder_.path() / ".file.part") << "a file";
  EXPECT_EQ(*RemoveUnfinished(folder_.path()), 1u);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / ".20260101T000000.000Z-x.part"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / "x.part"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / ".a b.part"));
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / ".file.part"));
  EXPECT_TRUE(Session::Open(folder_.path(), id).ok());
}

TEST_F(Housekeeping, FreeBytesNeedNoFolder) {
  const auto bytes = FreeBytes(folder_.path() / "not" / "there");
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  EXPECT_GT(*bytes, 0u);
}

// Equal pixels, equal digest; whatever happened on the way does not matter.
TEST_F(Housekeeping, TheContentDigestIsOfPixelsAlone) {
  const auto digest = [&](const std::string& id) {
    const auto report = VerifySession(folder_.path(), id, nullptr);
    EXPECT_TRUE(report.ok()) << report.status();
    EXPECT_TRUE(report->imbalances.empty());
    return report->content_digest;
  };
  const std::string plain = digest(CreateComplete());
  const auto again = Create();
  ASSERT_TRUE(again->Append(FrameOf(3, 5), PixelsOf(1, 1)).ok());  // will be superseded
  for (const Step& step : plan_.steps) {
    if (step.kind != StepKind::kShot) continue;
    for (auto camera = step.cameras.rbegin(); camera != step.cameras.rend(); ++camera) {
      ASSERT_TRUE(again->Append(FrameOf(*camera, step.shot), PixelsOf(*camera, step.shot)).ok());
    }
  }
  ASSERT_TRUE(again->Finish(true, "", 1, 1, true).ok());
  EXPECT_EQ(digest(again->id()), plain);
  const auto other = Create();
  ASSERT_TRUE(AppendAll(*other, plan_).ok());
  ASSERT_TRUE(other->Append(FrameOf(3, 5), PixelsOf(1, 1)).ok());
  ASSERT_TRUE(other->Finish(true, "", 1, 1, true).ok());
  EXPECT_NE(digest(other->id()), plain);
}

}  // namespace
}  // namespace mesorig::daemon
