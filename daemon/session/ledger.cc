#include "daemon/session/ledger.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>

namespace mesorig::daemon {
namespace {

constexpr char kSchema[] = R"(
  PRAGMA application_id = 0x4D534A31;
  PRAGMA user_version = 2;
  CREATE TABLE session (
    only INTEGER PRIMARY KEY CHECK (only = 1),
    id TEXT NOT NULL, plan_name TEXT NOT NULL, plan_sha256 TEXT NOT NULL,
    rig_sha256 TEXT NOT NULL, frames_planned INTEGER NOT NULL,
    end INTEGER NOT NULL, reason TEXT NOT NULL, deterministic INTEGER NOT NULL,
    virtual_s REAL NOT NULL, wall_s REAL NOT NULL) STRICT;
  CREATE TABLE frame (
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
)";
constexpr int kApplicationId = 0x4D534A31;  // "MSJ1"
static_assert(Ledger::kSchemaVersion == 2, "kSchema says so too");

constexpr char kColumns[] =
    "camera, sequence, shot, trigger_id, frame_id, supersedes, exposure_start_ns, "
    "exposure_end_ns, exposure_s, axis_rad, lamp_level, width, height, bits, region_x, region_y, "
    "laser_sweep, laser_index, laser_mount, laser_tilt_rad, laser_on, digest, segment, offset, "
    "bytes";

// A prepared statement, finalised with the object. Parameters and columns are taken in order.
class Statement {
 public:
  Statement(sqlite3* db, const std::string& sql) {
    sqlite3_prepare_v2(db, sql.c_str(), -1, &statement_, nullptr);
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;
  bool ok() const { return statement_ != nullptr; }
  sqlite3_stmt* get() { return statement_; }
  int Step() { return statement_ == nullptr ? SQLITE_ERROR : sqlite3_step(statement_); }

 private:
  sqlite3_stmt* statement_ = nullptr;
};

// Binds one value after the other.
class Binder {
 public:
  explicit Binder(sqlite3_stmt* statement) : statement_(statement) {}
  Binder& Int(int64_t value) {
    sqlite3_bind_int64(statement_, ++at_, value);
    return *this;
  }
  Binder& Real(double value) {
    sqlite3_bind_double(statement_, ++at_, value);
    return *this;
  }
  Binder& Null() {
    sqlite3_bind_null(statement_, ++at_);
    return *this;
  }
  Binder& Text(const std::string& value) {
    sqlite3_bind_text(statement_, ++at_, value.data(), static_cast<int>(value.size()),
                      SQLITE_TRANSIENT);
    return *this;
  }
  Binder& Doubles(const std::vector<double>& values) {
    // (An empty vector has a null pointer, which would bind NULL.)
    if (values.empty()) {
      sqlite3_bind_zeroblob(statement_, ++at_, 0);
    } else {
      sqlite3_bind_blob(statement_, ++at_, values.data(),
                        static_cast<int>(values.size() * sizeof(double)), SQLITE_TRANSIENT);
    }
    return *this;
  }

 private:
  sqlite3_stmt* statement_;
  int at_ = 0;
};

class Columns {
 public:
  explicit Columns(sqlite3_stmt* row) : row_(row) {}
  int64_t Int() { return sqlite3_column_int64(row_, at_++); }
  double Real() { return sqlite3_column_double(row_, at_++); }
  bool IsNull() const { return sqlite3_column_type(row_, at_) == SQLITE_NULL; }
  std::string Text() {
    const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(row_, at_));
    const int size = sqlite3_column_bytes(row_, at_++);
    return text == nullptr ? std::string() : std::string(text, static_cast<size_t>(size));
  }
  std::vector<double> Doubles() {
    const void* blob = sqlite3_column_blob(row_, at_);
    const auto count = static_cast<size_t>(sqlite3_column_bytes(row_, at_++)) / sizeof(double);
    std::vector<double> values(count);
    if (count > 0) std::memcpy(values.data(), blob, count * sizeof(double));
    return values;
  }

 private:
  sqlite3_stmt* row_;
  int at_ = 0;
};

// Frames without laser have NULL in all its columns.
void BindLaser(Binder& binder, const std::optional<LaserRecord>& laser) {
  if (!laser) {
    binder.Null().Null().Null().Null().Null();
    return;
  }
  binder.Int(laser->sweep).Int(laser->index).Int(laser->mount).Real(laser->tilt_rad);
  binder.Int(laser->on);
}

std::optional<LaserRecord> ReadLaser(Columns& columns) {
  const bool none = columns.IsNull();
  LaserRecord laser;
  laser.sweep = static_cast<uint32_t>(columns.Int());
  laser.index = static_cast<uint32_t>(columns.Int());
  laser.mount = static_cast<int>(columns.Int());
  laser.tilt_rad = columns.Real();
  laser.on = columns.Int() != 0;
  if (none) return std::nullopt;
  return laser;
}

void BindFrame(sqlite3_stmt* statement, const FrameRecord& r) {
  Binder binder(statement);
  binder.Int(r.camera)
      .Int(static_cast<int64_t>(r.sequence))
      .Int(r.shot)
      .Int(r.trigger_id)
      .Int(static_cast<int64_t>(r.frame_id))
      .Int(static_cast<int64_t>(r.supersedes))
      .Int(r.exposure_start_ns)
      .Int(r.exposure_end_ns)
      .Real(r.exposure_s)
      .Doubles(r.axis_rad)
      .Doubles(r.lamp_level)
      .Int(r.width)
      .Int(r.height)
      .Int(r.bits)
      .Int(r.region_x)
      .Int(r.region_y);
  BindLaser(binder, r.laser);
  binder.Text(r.digest)
      .Int(r.segment)
      .Int(static_cast<int64_t>(r.offset))
      .Int(static_cast<int64_t>(r.bytes));
}

FrameRecord ReadRow(sqlite3_stmt* row) {
  Columns columns(row);
  FrameRecord r;
  r.camera = static_cast<int>(columns.Int());
  r.sequence = static_cast<uint64_t>(columns.Int());
  r.shot = static_cast<uint32_t>(columns.Int());
  r.trigger_id = static_cast<uint32_t>(columns.Int());
  r.frame_id = static_cast<uint64_t>(columns.Int());
  r.supersedes = static_cast<uint64_t>(columns.Int());
  r.exposure_start_ns = columns.Int();
  r.exposure_end_ns = columns.Int();
  r.exposure_s = columns.Real();
  r.axis_rad = columns.Doubles();
  r.lamp_level = columns.Doubles();
  r.width = static_cast<int>(columns.Int());
  r.height = static_cast<int>(columns.Int());
  r.bits = static_cast<int>(columns.Int());
  r.region_x = static_cast<int>(columns.Int());
  r.region_y = static_cast<int>(columns.Int());
  r.laser = ReadLaser(columns);
  r.digest = columns.Text();
  r.segment = static_cast<uint32_t>(columns.Int());
  r.offset = static_cast<uint64_t>(columns.Int());
  r.bytes = static_cast<uint64_t>(columns.Int());
  return r;
}

}  // namespace

StatusOr<std::unique_ptr<Ledger>> Ledger::Create(const std::filesystem::path& path,
                                                 const SessionSummary& session) {
  std::unique_ptr<Ledger> ledger(new Ledger(path));
  MESORIG_RETURN_IF_ERROR(ledger->Connect(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE));
  MESORIG_RETURN_IF_ERROR(ledger->Execute(kSchema, "creating the tables"));
  Statement insert(ledger->db_, "INSERT INTO session VALUES (1,?,?,?,?,?,?,?,?,?,?)");
  if (!insert.ok()) return ledger->Error("writing the session record");
  Binder(insert.get())
      .Text(session.id)
      .Text(session.plan_name)
      .Text(session.plan_sha256)
      .Text(session.rig_sha256)
      .Int(session.frames_planned)
      .Int(static_cast<int>(session.end))
      .Text(session.reason)
      .Int(session.deterministic)
      .Real(session.virtual_s)
      .Real(session.wall_s);
  if (insert.Step() != SQLITE_DONE) return ledger->Error("writing the session record");
  return ledger;
}

StatusOr<std::unique_ptr<Ledger>> Ledger::Open(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    return NotFound("{}: no such file", path.string());
  }
  std::unique_ptr<Ledger> ledger(new Ledger(path));
  MESORIG_RETURN_IF_ERROR(ledger->Connect(SQLITE_OPEN_READWRITE));
  Statement id(ledger->db_, "PRAGMA application_id");
  if (!id.ok() || id.Step() != SQLITE_ROW) return ledger->Error("reading");
  if (sqlite3_column_int(id.get(), 0) != kApplicationId) {
    return DataLoss("{}: is not a session journal", path.string());
  }
  MESORIG_ASSIGN_OR_RETURN(const int version, ledger->UserVersion());
  if (version != kSchemaVersion) {
    return FailedPrecondition("{}: schema version {} is {} than {}, which this program reads",
                              path.string(), version, version < kSchemaVersion ? "older" : "newer",
                              kSchemaVersion);
  }
  return ledger;
}

Ledger::~Ledger() {
  sqlite3_finalize(find_);
  sqlite3_close_v2(db_);
}

Status Ledger::Connect(int flags) {
  if (sqlite3_open_v2(path_.c_str(), &db_, flags | SQLITE_OPEN_NOMUTEX, nullptr) != SQLITE_OK) {
    return Error("opening");
  }
  sqlite3_busy_timeout(db_, 5000);
  return Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;", "opening");
}

Status Ledger::Error(std::string_view operation) const {
  const int code = db_ == nullptr ? SQLITE_NOMEM : sqlite3_errcode(db_);
  const char* text = db_ == nullptr ? "out of memory" : sqlite3_errmsg(db_);
  if (code == SQLITE_NOTADB || code == SQLITE_CORRUPT || code == SQLITE_ERROR) {
    return DataLoss("{}: {}: is not a whole session journal ({})", path_.string(), operation, text);
  }
  return Unavailable("{}: {}: {}", path_.string(), operation, text);
}

Status Ledger::Execute(const char* sql, std::string_view operation) {
  if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) return Error(operation);
  return OkStatus();
}

StatusOr<int> Ledger::UserVersion() {
  Statement version(db_, "PRAGMA user_version");
  if (!version.ok() || version.Step() != SQLITE_ROW) return Error("reading the schema version");
  return sqlite3_column_int(version.get(), 0);
}

Status Ledger::InsertRows(const std::vector<FrameRecord>& rows) {
  Statement insert(db_, fmt::format("INSERT INTO frame ({}) VALUES "
                                    "(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)",
                                    kColumns));
  for (const FrameRecord& row : rows) {
    if (!insert.ok()) return Error("preparing ledger rows");
    BindFrame(insert.get(), row);
    if (insert.Step() != SQLITE_DONE) {
      return Error(fmt::format("writing {} ledger rows", rows.size()));
    }
    sqlite3_reset(insert.get());
  }
  return OkStatus();
}

Status Ledger::Commit(const std::vector<FrameRecord>& rows) {
  MESORIG_RETURN_IF_ERROR(Execute("BEGIN IMMEDIATE", "beginning a transaction"));
  Status status = InsertRows(rows);
  if (status.ok()) {
    status = Execute("COMMIT", fmt::format("committing {} ledger rows", rows.size()));
  }
  if (!status.ok()) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  return status;
}

Status Ledger::WriteEnd(const SessionSummary& session) {
  Statement update(db_,
                   "UPDATE session SET end=?, reason=?, deterministic=?, virtual_s=?, wall_s=?");
  if (!update.ok()) return Error("writing the session's end");
  Binder(update.get())
      .Int(static_cast<int>(session.end))
      .Text(session.reason)
      .Int(session.deterministic)
      .Real(session.virtual_s)
      .Real(session.wall_s);
  if (update.Step() != SQLITE_DONE) return Error("writing the session's end");
  return OkStatus();
}

Status Ledger::Checkpoint() {
  if (sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr) !=
      SQLITE_OK) {
    return Error("checkpoint");
  }
  return OkStatus();
}

StatusOr<SessionSummary> Ledger::ReadSummary() {
  Statement query(db_,
                  "SELECT id, plan_name, plan_sha256, rig_sha256, frames_planned, end, reason, "
                  "deterministic, virtual_s, wall_s, (SELECT count(*) FROM frame) FROM session");
  const int step = query.Step();
  if (step == SQLITE_DONE) return DataLoss("{}: has no session record", path_.string());
  if (step != SQLITE_ROW) return Error("reading the session record");
  Columns columns(query.get());
  SessionSummary s;
  s.id = columns.Text();
  s.plan_name = columns.Text();
  s.plan_sha256 = columns.Text();
  s.rig_sha256 = columns.Text();
  s.frames_planned = static_cast<uint32_t>(columns.Int());
  const int64_t end = columns.Int();
  if (end < 0 || end > static_cast<int>(SessionEnd::kIncomplete)) {
    return DataLoss("{}: the session's end is {}, not in [0, 2]", path_.string(), end);
  }
  s.end = static_cast<SessionEnd>(end);
  s.reason = columns.Text();
  s.deterministic = columns.Int() != 0;
  s.virtual_s = columns.Real();
  s.wall_s = columns.Real();
  s.frames_durable = static_cast<uint32_t>(columns.Int());
  return s;
}

StatusOr<std::optional<FrameRecord>> Ledger::Find(int camera, uint64_t sequence) {
  if (find_ == nullptr) {
    const std::string sql =
        fmt::format("SELECT {} FROM frame WHERE camera=? AND sequence=?", kColumns);
    if (sqlite3_prepare_v2(db_, sql.c_str(), -1, &find_, nullptr) != SQLITE_OK) {
      return Error("preparing a ledger look-up");
    }
  }
  Binder(find_).Int(camera).Int(static_cast<int64_t>(sequence));
  const int step = sqlite3_step(find_);
  StatusOr<std::optional<FrameRecord>> found = std::optional<FrameRecord>();
  if (step == SQLITE_ROW) {
    found = std::optional<FrameRecord>(ReadRow(find_));
  } else if (step != SQLITE_DONE) {
    found = Error(fmt::format("reading ledger row {} of camera {}", sequence, camera));
  }
  sqlite3_reset(find_);  // also ends the read transaction
  return found;
}

StatusOr<uint64_t> Ledger::LastOfStretch(const FrameRecord& row) {
  Statement query(db_,
                  "SELECT coalesce("
                  "(SELECT min(sequence) - 1 FROM frame WHERE camera=?1 AND sequence>?2 AND "
                  "segment<>?3), (SELECT max(sequence) FROM frame WHERE camera=?1), ?2)");
  if (query.ok()) {
    Binder(query.get()).Int(row.camera).Int(static_cast<int64_t>(row.sequence)).Int(row.segment);
  }
  if (query.Step() != SQLITE_ROW) return Error("reading the rows of a released sweep");
  // (A damaged index could answer with less, and its caller would not come on.)
  return std::max(row.sequence, static_cast<uint64_t>(Columns(query.get()).Int()));
}

StatusOr<Ledger::Coverage> Ledger::Cover(int camera, uint32_t segment, uint32_t first,
                                         uint32_t count) {
  Statement query(db_,
                  "SELECT count(DISTINCT shot), coalesce(max(offset + bytes), 0) FROM frame "
                  "WHERE camera=? AND segment=? AND shot>=? AND shot<?");
  if (query.ok()) {
    Binder(query.get()).Int(camera).Int(segment).Int(first).Int(int64_t{first} + count);
  }
  if (query.Step() != SQLITE_ROW) return Error("counting the rows of a sweep");
  Columns columns(query.get());
  Coverage coverage;
  coverage.shots = static_cast<uint32_t>(columns.Int());
  coverage.last_bytes = static_cast<uint64_t>(columns.Int());
  return coverage;
}

StatusOr<std::vector<uint64_t>> Ledger::LastSequences(int cameras) {
  std::vector<uint64_t> last(static_cast<size_t>(cameras), 0);
  Statement query(db_, "SELECT camera, max(sequence) FROM frame GROUP BY camera");
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    Columns columns(query.get());
    const int64_t camera = columns.Int();
    if (camera < 0 || camera >= cameras) {
      return DataLoss("{}: has frames of camera {}, the rig has {}", path_.string(), camera,
                      cameras);
    }
    last[static_cast<size_t>(camera)] = static_cast<uint64_t>(columns.Int());
  }
  if (step != SQLITE_DONE) return Error("counting the ledger's rows");
  return last;
}

Status Ledger::ForEach(const std::function<Status(const FrameRecord&)>& visit) {
  Statement query(db_, fmt::format("SELECT {} FROM frame ORDER BY camera, sequence", kColumns));
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    MESORIG_RETURN_IF_ERROR(visit(ReadRow(query.get())));
  }
  if (step != SQLITE_DONE) return Error("reading the ledger");
  return OkStatus();
}

}  // namespace mesorig::daemon
