// A small session dies at every operation that it does on the disk, after every record of its
// journal, and by power cuts; it is resumed and completed, and is then as one that never died.

#include "daemon/session/verify.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/protocol/base/scripted_disk.h"

namespace mesorig::daemon {
namespace {

// Three lamp shots of cameras 0 and 3, then a sweep of three frames of camera 3 that is kept and
// one of two frames of both that is not.
CompiledPlan TinyPlan(const Rig& rig) {
  CompiledPlan plan = SweepingPlan(rig);
  std::vector<Step> steps;
  plan.shots = plan.frames = plan.sweeps = 0;
  for (Step step : plan.steps) {
    const bool sweeps = step.kind == StepKind::kSweep;
    if (step.kind != StepKind::kShot && !sweeps) {
      steps.push_back(step);
      continue;
    }
    if (sweeps ? plan.sweeps == 2 : plan.shots == 3) continue;
    step.shot = plan.shots;
    step.cameras = sweeps && plan.sweeps == 0 ? std::vector<int>{3} : std::vector<int>{0, 3};
    if (sweeps) {
      step.sweep.index = plan.sweeps++;
      step.sweep.frames = step.sweep.index == 0 ? 3 : 2;
      step.sweep.keep_frames = step.sweep.index == 0;
      step.sweep.regions.assign(step.cameras.size(), Region{0, 2, 4, 6});
    }
    plan.shots += sweeps ? step.sweep.frames : 1;
    plan.frames += (sweeps ? step.sweep.frames : 1) * static_cast<uint32_t>(step.cameras.size());
    steps.push_back(step);
  }
  plan.steps = std::move(steps);
  return plan;
}

enum class Death { kKill, kTorn, kPowerCut };

class DeathTest : public ::testing::Test {
 protected:
  // In memory where there is such a folder: what a sync costs is not the question here.
  DeathTest() {
    std::error_code error;
    if (std::filesystem::is_directory("/dev/shm", error)) {
      std::string name = "/dev/shm/mesorig-death-XXXXXX";
      if (::mkdtemp(name.data()) != nullptr) root_ = name;
    }
    if (root_.empty()) root_ = folder_.path();
  }
  ~DeathTest() override {
    std::error_code ignored;
    std::filesystem::remove_all(root_, ignored);
  }

  // The frame that the rig gives: its pixels depend on camera and shot alone.
  static Status Shoot(Session& session, const Step& step, uint32_t shot, int camera) {
    if (step.kind == StepKind::kShot) {
      return session.Append(FrameOf(camera, shot), PixelsOf(camera, shot));
    }
    for (size_t k = 0; k < step.cameras.size(); ++k) {
      if (step.cameras[k] == camera) {
        return AppendSweepFrame(session, SweepFrameOf(step, k, shot - step.shot));
      }
    }
    return Internal("camera {} does not see this sweep", camera);
  }

  // What the sequencer does: takes what is missing, and journals. A flush after each record, so
  // that each is a transaction of its own.
  static Status Capture(Session& session, const CompiledPlan& plan) {
    MESORIG_RETURN_IF_ERROR(session.Record({JournalKind::kBegan, 0, -1, 0, "began"}));
    MESORIG_RETURN_IF_ERROR(session.Flush());
    for (const Step& step : plan.steps) {
      if (step.kind != StepKind::kShot && step.kind != StepKind::kSweep) continue;
      const uint32_t frames = step.kind == StepKind::kSweep ? step.sweep.frames : 1;
      for (uint32_t shot = step.shot; shot < step.shot + frames; ++shot) {
        for (const int camera : session.Missing(shot)) {
          MESORIG_RETURN_IF_ERROR(Shoot(session, step, shot, camera));
          MESORIG_RETURN_IF_ERROR(session.Flush());
        }
      }
    }
    MESORIG_ASSIGN_OR_RETURN(const uint32_t dropped, session.DropDamaged());
    if (dropped > 0) return DataLoss("{} frames were damaged", dropped);
    return session.Finish(true, "", 1, 1, true);
  }

  // One session that dies at operation `n`. Returns whether it came to that, and fills in `acked`.
  bool RunToDeath(uint64_t n, Death death, std::filesystem::path& root, uint32_t& acked) {
    root = root_ / fmt::format("{}-{}", n, static_cast<int>(death));
    ScriptedDisk disk;
    disk.DieAt(n, death == Death::kTorn);
    {
      auto session = Session::Create(root, plan_, rig_, {.faults = &disk});
      if (session.ok()) {
        std::atomic<uint32_t> durable{0};
        (*session)->OnDurable([&](uint32_t frames) { durable = frames; });
        const Status status = Capture(**session, plan_);
        EXPECT_EQ(status.ok(), !disk.is_dead()) << status;
        session->reset();
        acked = durable;
      }
    }
    if (!disk.is_dead()) return false;
    if (death == Death::kPowerCut) disk.CutPower(static_cast<uint32_t>(n));
    return true;
  }

  // Resumes what is there, or starts anew, and completes it; "" when all is as it should be.
  std::string Recover(const std::filesystem::path& root, uint32_t acked) {
    auto ids = ListSessions(root);
    if (!ids.ok()) return ids.status().ToString();
    if (ids->empty()) {
      if (acked > 0) return "a session with acknowledged frames is gone";
      auto session = Session::Create(root, plan_, rig_);
      if (!session.ok()) return session.status().ToString();
      const Status status = Capture(**session, plan_);
      if (!status.ok()) return status.ToString();
      ids = ListSessions(root);
    } else {
      auto session = Session::Resume(root, ids->front(), rig_);
      if (session.ok()) {
        const uint32_t durable = (*session)->Summary().frames_durable;
        if (durable < acked) return fmt::format("{} of {} acknowledged are there", durable, acked);
        const Status status = Capture(**session, plan_);
        if (!status.ok()) return status.ToString();
      } else if (!absl::IsFailedPrecondition(session.status())) {  // (complete already)
        return session.status().ToString();
      }
    }
    const auto report = VerifySession(root, ids->front(), nullptr);
    if (!report.ok()) return report.status().ToString();
    if (report->summary.end != SessionEnd::kComplete) return "not complete";
    if (!report->imbalances.empty()) return report->imbalances.front().first;
    if (report->rows != plan_.frames) return fmt::format("{} rows", report->rows);
    if (report->content_digest != expected_) return "another content";
    return "";
  }

  // The content of a session that never dies, and the operations that it does.
  void RunUntouched() {
    ScriptedDisk disk;
    const auto root = root_ / "untouched";
    auto session = Session::Create(root, plan_, rig_, {.faults = &disk});
    ASSERT_TRUE(session.ok()) << session.status();
    const Status status = Capture(**session, plan_);
    ASSERT_TRUE(status.ok()) << status;
    const auto report = VerifySession(root, (*session)->id(), nullptr);
    ASSERT_TRUE(report.ok()) << report.status();
    expected_ = report->content_digest;
    session->reset();
    operations_ = disk.operations();
  }

  void DieEverywhere(Death death, std::string_view name) {
    RunUntouched();
    uint32_t tried = 0, survived = 0;
    for (uint64_t n = 0; n < operations_; ++n) {
      std::filesystem::path root;
      uint32_t acked = 0;
      if (!RunToDeath(n, death, root, acked)) break;
      ++tried;
      const std::string wrong = Recover(root, acked);
      EXPECT_EQ(wrong, "") << name << " at operation " << n;
      survived += wrong.empty();
      std::error_code ignored;
      std::filesystem::remove_all(root, ignored);
    }
    fmt::print("{}: {} survived of {} tried, at {} operations on the disk\n", name, survived, tried,
               operations_);
    EXPECT_GT(tried, 100u);
  }

  TemporaryFolder folder_;
  std::filesystem::path root_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = TinyPlan(rig_);
  std::string expected_;
  uint64_t operations_ = 0;
};

TEST_F(DeathTest, KilledAtEveryOperation) { DieEverywhere(Death::kKill, "kills"); }
TEST_F(DeathTest, KilledInTheMiddleOfEveryWrite) { DieEverywhere(Death::kTorn, "torn writes"); }
TEST_F(DeathTest, PowerCutAtEveryOperation) { DieEverywhere(Death::kPowerCut, "power cuts"); }

// Dead after each of its journal's records, as a kill between two of them leaves it; again and
// again in one session.
TEST_F(DeathTest, KilledAfterEveryRecordOfOneSession) {
  RunUntouched();
  const auto root = root_ / "again";
  std::string id;
  uint32_t deaths = 0;
  for (uint32_t n = 1;; ++n) {
    auto session =
        id.empty() ? Session::Create(root, plan_, rig_) : Session::Resume(root, id, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    id = (*session)->id();
    // One record, then gone without an end.
    bool shot_one = false;
    for (const Step& step : plan_.steps) {
      if (step.kind != StepKind::kShot && step.kind != StepKind::kSweep) continue;
      const uint32_t frames = step.kind == StepKind::kSweep ? step.sweep.frames : 1;
      for (uint32_t shot = step.shot; shot < step.shot + frames && !shot_one; ++shot) {
        const auto missing = (*session)->Missing(shot);
        if (missing.empty()) continue;
        ASSERT_TRUE(Shoot(**session, step, shot, missing.front()).ok());
        shot_one = true;
      }
    }
    ASSERT_TRUE((*session)->Record({JournalKind::kNote, 0, -1, 0, fmt::format("{}", n)}).ok());
    ASSERT_TRUE((*session)->Flush().ok());
    if (!shot_one) {
      ASSERT_TRUE((*session)->Finish(true, "", 1, 1, true).ok());
      break;
    }
    ++deaths;
  }
  EXPECT_EQ(deaths, plan_.frames);
  const auto report = VerifySession(root, id, nullptr);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_TRUE(report->imbalances.empty());
  EXPECT_EQ(report->content_digest, expected_);
  EXPECT_EQ(report->entries.size(), deaths + 2) << "the last one is the end";
  EXPECT_EQ(report->entries.back().kind, JournalKind::kEnded);
  EXPECT_EQ(report->summary.starts, deaths + 1);
}

}  // namespace
}  // namespace mesorig::daemon
