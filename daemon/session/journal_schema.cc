#include "daemon/session/journal_schema.h"

#include <sqlite3.h>

#include "daemon/session/sqlite_statement.h"

namespace mesorig::daemon {
namespace {

constexpr char kTables[] = R"(
  BEGIN IMMEDIATE;
  PRAGMA application_id = 0x4D534A31;
  PRAGMA user_version = 3;
  CREATE TABLE session (
    only INTEGER PRIMARY KEY CHECK (only = 1),
    id TEXT NOT NULL, plan_name TEXT NOT NULL, plan_sha256 TEXT NOT NULL,
    rig_sha256 TEXT NOT NULL, frames_planned INTEGER NOT NULL,
    end INTEGER NOT NULL, reason TEXT NOT NULL, deterministic INTEGER NOT NULL,
    virtual_s REAL NOT NULL, wall_s REAL NOT NULL,
    sample_name TEXT NOT NULL DEFAULT '', sample_sha256 TEXT NOT NULL DEFAULT '',
    starts INTEGER NOT NULL DEFAULT 1) STRICT;
  CREATE TABLE frame (
    camera INTEGER NOT NULL, sequence INTEGER NOT NULL,
    shot INTEGER NOT NULL, trigger_id INTEGER NOT NULL, frame_id INTEGER NOT NULL,
    supersedes INTEGER NOT NULL,
    exposure_start_ns INTEGER NOT NULL, exposure_end_ns INTEGER NOT NULL,
    exposure_s REAL NOT NULL, axis_rad BLOB NOT NULL, lamp_level BLOB NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, bits INTEGER NOT NULL,
    region_x INTEGER NOT NULL DEFAULT 0, region_y INTEGER NOT NULL DEFAULT 0,
    laser_sweep INTEGER, laser_index INTEGER, laser_mount INTEGER, laser_tilt_rad REAL,
    laser_on INTEGER,
    digest TEXT NOT NULL, segment INTEGER NOT NULL DEFAULT 0, offset INTEGER NOT NULL,
    bytes INTEGER NOT NULL, run INTEGER NOT NULL DEFAULT 0,
    PRIMARY KEY (camera, sequence)) STRICT, WITHOUT ROWID;
  CREATE INDEX frame_of_shot ON frame (camera, shot);
  CREATE TABLE entry (
    number INTEGER PRIMARY KEY, kind INTEGER NOT NULL, rig_ns INTEGER NOT NULL,
    item INTEGER NOT NULL, value REAL NOT NULL, text TEXT NOT NULL) STRICT;
  COMMIT;
)";
static_assert(kJournalApplicationId == 0x4D534A31 && kJournalVersion == 3, "kTables says so too");

// 1 had neither regions nor laser nor segments of sweeps.
constexpr char kFrom1[] = R"(
  ALTER TABLE frame ADD COLUMN region_x INTEGER NOT NULL DEFAULT 0;
  ALTER TABLE frame ADD COLUMN region_y INTEGER NOT NULL DEFAULT 0;
  ALTER TABLE frame ADD COLUMN laser_sweep INTEGER;
  ALTER TABLE frame ADD COLUMN laser_index INTEGER;
  ALTER TABLE frame ADD COLUMN laser_mount INTEGER;
  ALTER TABLE frame ADD COLUMN laser_tilt_rad REAL;
  ALTER TABLE frame ADD COLUMN laser_on INTEGER;
  ALTER TABLE frame ADD COLUMN segment INTEGER NOT NULL DEFAULT 0;
)";
// 2 had no entries, no sample, and one run.
constexpr char kFrom2[] = R"(
  ALTER TABLE session ADD COLUMN sample_name TEXT NOT NULL DEFAULT '';
  ALTER TABLE session ADD COLUMN sample_sha256 TEXT NOT NULL DEFAULT '';
  ALTER TABLE session ADD COLUMN starts INTEGER NOT NULL DEFAULT 1;
  ALTER TABLE frame ADD COLUMN run INTEGER NOT NULL DEFAULT 0;
  CREATE INDEX frame_of_shot ON frame (camera, shot);
  CREATE TABLE entry (
    number INTEGER PRIMARY KEY, kind INTEGER NOT NULL, rig_ns INTEGER NOT NULL,
    item INTEGER NOT NULL, value REAL NOT NULL, text TEXT NOT NULL) STRICT;
  PRAGMA user_version = 3;
)";

int Run(sqlite3* db, const char* sql) { return sqlite3_exec(db, sql, nullptr, nullptr, nullptr); }

}  // namespace

int CreateJournalTables(sqlite3* db) { return Run(db, kTables); }

int JournalVersionOf(sqlite3* db) {
  Statement version(db, "PRAGMA user_version");
  return version.Step() == SQLITE_ROW ? sqlite3_column_int(version.get(), 0) : -1;
}

int MigrateJournal(sqlite3* db) {
  int code = Run(db, "BEGIN IMMEDIATE");
  if (code != SQLITE_OK) return code;
  // (Asked with the lock held: somebody else may have been here first.)
  const int version = JournalVersionOf(db);
  if (version == 1) code = Run(db, kFrom1);
  if (code == SQLITE_OK && (version == 1 || version == 2)) code = Run(db, kFrom2);
  if (code == SQLITE_OK) code = Run(db, "COMMIT");
  return code;  // (Closing the connection rolls it back, and until then it tells what went wrong.)
}

}  // namespace mesorig::daemon
