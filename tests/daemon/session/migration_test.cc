// Journals of older versions: opened, they become today's, with everything that they had.

#include <sqlite3.h>

#include "daemon/session/journal_schema.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

constexpr char kSession[] = R"(
  PRAGMA old.application_id = 0x4D534A31;
  CREATE TABLE old.session (
    only INTEGER PRIMARY KEY CHECK (only = 1),
    id TEXT NOT NULL, plan_name TEXT NOT NULL, plan_sha256 TEXT NOT NULL,
    rig_sha256 TEXT NOT NULL, frames_planned INTEGER NOT NULL,
    end INTEGER NOT NULL, reason TEXT NOT NULL, deterministic INTEGER NOT NULL,
    virtual_s REAL NOT NULL, wall_s REAL NOT NULL) STRICT;
  INSERT INTO old.session SELECT only, id, plan_name, plan_sha256, rig_sha256, frames_planned, end,
    reason, deterministic, virtual_s, wall_s FROM session;
)";
constexpr char kFrame1[] = R"(
  PRAGMA old.user_version = 1;
  CREATE TABLE old.frame (
    camera INTEGER NOT NULL, sequence INTEGER NOT NULL,
    shot INTEGER NOT NULL, trigger_id INTEGER NOT NULL, frame_id INTEGER NOT NULL,
    supersedes INTEGER NOT NULL,
    exposure_start_ns INTEGER NOT NULL, exposure_end_ns INTEGER NOT NULL,
    exposure_s REAL NOT NULL, axis_rad BLOB NOT NULL, lamp_level BLOB NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, bits INTEGER NOT NULL,
    digest TEXT NOT NULL, offset INTEGER NOT NULL, bytes INTEGER NOT NULL,
    PRIMARY KEY (camera, sequence)) STRICT, WITHOUT ROWID;
  INSERT INTO old.frame SELECT camera, sequence, shot, trigger_id, frame_id, supersedes,
    exposure_start_ns, exposure_end_ns, exposure_s, axis_rad, lamp_level, width, height, bits,
    digest, offset, bytes FROM frame;
)";
constexpr char kFrame2[] = R"(
  PRAGMA old.user_version = 2;
  CREATE TABLE old.frame (
    camera INTEGER NOT NULL, sequence INTEGER NOT NULL,
    shot INTEGER NOT NULL, trigger_id INTEGER NOT NULL, frame_id INTEGER NOT NULL,
    supersedes INTEGER NOT NULL,
    exposure_start_ns INTEGER NOT NULL, exposure_end_ns INTEGER NOT NULL,
    exposure_s REAL NOT NULL, axis_rad BLOB NOT NULL, lamp_level BLOB NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, bits INTEGER NOT NULL,
    region_x INTEGER NOT NULL, region_y INTEGER NOT NULL,
    laser_sweep INTEGER, laser_index INTEGER, laser_mount INTEGER, laser_tilt_rad REAL,
    laser_on INTEGER,
    digest TEXT NOT NULL, segment INTEGER NOT NULL, offset INTEGER NOT NULL,
    bytes INTEGER NOT NULL,
    PRIMARY KEY (camera, sequence)) STRICT, WITHOUT ROWID;
  INSERT INTO old.frame SELECT camera, sequence, shot, trigger_id, frame_id, supersedes,
    exposure_start_ns, exposure_end_ns, exposure_s, axis_rad, lamp_level, width, height, bits,
    region_x, region_y, laser_sweep, laser_index, laser_mount, laser_tilt_rad, laser_on, digest,
    segment, offset, bytes FROM frame;
)";

class Migration : public ::testing::Test {
 protected:
  // A session of this plan, as the program of that version would have left it.
  void MakeOld(const CompiledPlan& plan, int version, uint32_t shots, bool complete) {
    auto session = Session::Create(folder_.path(), plan, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    id_ = (*session)->id();
    for (const Step& step : plan.steps) {
      if (step.kind == StepKind::kShot && step.shot < shots) {
        ASSERT_TRUE(AppendShot(**session, step).ok());
      }
      if (step.kind == StepKind::kSweep && step.shot < shots) {
        ASSERT_TRUE(AppendSweep(**session, step).ok());
      }
    }
    ASSERT_TRUE(complete ? (*session)->Finish(true, "", 3, 4, true).ok()
                         : (*session)->Finish(false, "stopped", 3, 4, true).ok());
    session->reset();
    const auto journal = folder_.path() / id_ / "journal.sqlite";
    const auto old = folder_.path() / "old.sqlite";
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(journal.c_str(), &db), SQLITE_OK);
    const std::string sql = fmt::format("ATTACH '{}' AS old; {} {}", old.string(), kSession,
                                        version == 1 ? kFrame1 : kFrame2);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(db);
    sqlite3_close(db);
    std::filesystem::rename(old, journal);
  }
  int VersionOnDisk() {
    sqlite3* db = nullptr;
    EXPECT_EQ(sqlite3_open((folder_.path() / id_ / "journal.sqlite").c_str(), &db), SQLITE_OK);
    const int version = JournalVersionOf(db);
    sqlite3_close(db);
    return version;
  }

  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  std::string id_;
};

TEST_F(Migration, AnOldSessionIsReadAndStaysWhole) {
  for (const int version : {1, 2}) {
    const CompiledPlan plan = version == 1 ? SmallPlan(rig_) : SweepingPlan(rig_);
    MakeOld(plan, version, plan.shots, true);
    ASSERT_EQ(VersionOnDisk(), version);
    const auto session = Session::Open(folder_.path(), id_);
    ASSERT_TRUE(session.ok()) << session.status();
    EXPECT_EQ(VersionOnDisk(), kJournalVersion);
    const SessionSummary summary = (*session)->Summary();
    EXPECT_EQ(summary.end, SessionEnd::kComplete);
    EXPECT_EQ(summary.virtual_s, 3);
    EXPECT_EQ(summary.frames_durable, plan.frames);
    EXPECT_EQ(summary.sample_name, "");
    EXPECT_EQ(summary.starts, 1u);
    const Replay replay = ReadAll(**session, 3, 20);
    EXPECT_TRUE(replay.bad.empty());
    ASSERT_EQ(replay.good.size(), version == 1 ? 8u : 20u);
    EXPECT_FALSE(replay.good[7].laser.has_value());
    if (version == 2) {
      EXPECT_EQ(replay.good[12].laser->sweep, 1u);
      EXPECT_EQ(replay.good[12].segment, 2u);
    }
    EXPECT_TRUE((*session)->Entries()->empty());
    EXPECT_TRUE(Session::Open(folder_.path(), id_).ok()) << "again";
  }
}

// And may be resumed where it stopped.
TEST_F(Migration, AnOldSessionGoesOn) {
  for (const int version : {1, 2}) {
    const CompiledPlan plan = version == 1 ? SmallPlan(rig_) : SweepingPlan(rig_);
    MakeOld(plan, version, 3, false);
    const auto session = Session::Resume(folder_.path(), id_, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    for (const Step& step : plan.steps) {
      if (step.kind == StepKind::kSweep) {
        ASSERT_TRUE(AppendSweep(**session, step).ok());
      } else if (step.kind == StepKind::kShot && !(*session)->Missing(step.shot).empty()) {
        ASSERT_TRUE(AppendShot(**session, step).ok());
      }
    }
    ASSERT_TRUE((*session)->Record({JournalKind::kResumed, 9'000'000'000, -1, 0, ""}).ok());
    const Status finished = (*session)->Finish(true, "", 1, 1, true);
    EXPECT_TRUE(finished.ok()) << finished;
    const auto entries = (*session)->Entries();
    ASSERT_EQ(entries->size(), 2u);
    EXPECT_EQ(entries->back().kind, JournalKind::kEnded);
    EXPECT_EQ(entries->back().rig_ns, 10'000'000'000) << "a second after it began";
    EXPECT_EQ(entries->back().text, "complete");
  }
}

// A migration that fails leaves the journal as it was.
TEST_F(Migration, IsWholeOrNotAtAll) {
  MakeOld(SmallPlan(rig_), 1, 8, true);
  const auto journal = folder_.path() / id_ / "journal.sqlite";
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(journal.c_str(), &db), SQLITE_OK);
  // (What the last step of the migration wants to create is there already.)
  ASSERT_EQ(sqlite3_exec(db, "CREATE TABLE entry (x)", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  const Status status = Session::Open(folder_.path(), id_).status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_NE(Message(status).find("migrating it from version 1 to 3"), std::string::npos) << status;
  EXPECT_EQ(VersionOnDisk(), 1);
  ASSERT_EQ(sqlite3_open(journal.c_str(), &db), SQLITE_OK);
  EXPECT_NE(sqlite3_exec(db, "SELECT segment FROM frame", nullptr, nullptr, nullptr), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(db, "DROP TABLE entry", nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(db);
  EXPECT_TRUE(Session::Open(folder_.path(), id_).ok());
}

TEST_F(Migration, ANewerJournalIsRefusedWithItsNumber) {
  MakeOld(SmallPlan(rig_), 2, 8, true);
  for (const int version : {4, 77, 0}) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open((folder_.path() / id_ / "journal.sqlite").c_str(), &db), SQLITE_OK);
    const std::string sql = fmt::format("PRAGMA user_version = {}", version);
    ASSERT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(db);
    const Status status = Session::Open(folder_.path(), id_).status();
    EXPECT_EQ(status.code(),
              version == 0 ? absl::StatusCode::kDataLoss : absl::StatusCode::kFailedPrecondition)
        << status;
    EXPECT_NE(Message(status).find(fmt::format("schema version {}", version)), std::string::npos)
        << status;
  }
}

}  // namespace
}  // namespace mesorig::daemon
