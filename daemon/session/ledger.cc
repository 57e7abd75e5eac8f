#include "daemon/session/ledger.h"

#include <sqlite3.h>

#include "daemon/session/journal_schema.h"
#include "daemon/session/ledger_rows.h"
#include "daemon/session/sqlite_statement.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<Ledger>> Ledger::Create(const std::filesystem::path& path,
                                                 const SessionSummary& session,
                                                 DiskFaults* faults) {
  std::unique_ptr<Ledger> ledger(new Ledger(path));
  MESORIG_RETURN_IF_ERROR(ledger->Connect(SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, faults));
  if (CreateJournalTables(ledger->db_) != SQLITE_OK) return ledger->Error("creating the tables");
  Statement insert(ledger->db_, "INSERT INTO session VALUES (1,?,?,?,?,?,?,?,?,?,?,?,?,1)");
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
      .Real(session.wall_s)
      .Text(session.sample_name)
      .Text(session.sample_sha256);
  if (insert.Step() != SQLITE_DONE) return ledger->Error("writing the session record");
  return ledger;
}

StatusOr<std::unique_ptr<Ledger>> Ledger::Open(const std::filesystem::path& path,
                                               DiskFaults* faults) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {
    return NotFound("{}: no such file", path.string());
  }
  std::unique_ptr<Ledger> ledger(new Ledger(path));
  MESORIG_RETURN_IF_ERROR(ledger->Connect(SQLITE_OPEN_READWRITE, faults));
  Statement id(ledger->db_, "PRAGMA application_id");
  if (id.Step() != SQLITE_ROW) return ledger->Error("reading");
  if (sqlite3_column_int(id.get(), 0) != kJournalApplicationId) {
    return DataLoss("{}: is not a session journal", path.string());
  }
  const int version = JournalVersionOf(ledger->db_);
  if (version < 0) return ledger->Error("reading the schema version");
  if (version > kJournalVersion) {
    return FailedPrecondition("{}: schema version {}, this program reads up to {}", path.string(),
                              version, kJournalVersion);
  }
  if (version == 0)
    return DataLoss("{}: schema version 0, not in [1, {}]", path.string(), kJournalVersion);
  if (version < kJournalVersion && MigrateJournal(ledger->db_) != SQLITE_OK) {
    return ledger->Error(
        fmt::format("migrating it from version {} to {}", version, kJournalVersion));
  }
  return ledger;
}

Ledger::~Ledger() {
  sqlite3_finalize(find_);
  sqlite3_close_v2(db_);
}

Status Ledger::Connect(int flags, DiskFaults* faults) {
  if (faults != nullptr) vfs_ = JournalVfs::Register(*faults);
  if (sqlite3_open_v2(path_.c_str(), &db_, flags | SQLITE_OPEN_NOMUTEX,
                      vfs_ ? vfs_->name() : nullptr) != SQLITE_OK) {
    return Error("opening");
  }
  // (With a hook nobody else has the file: a busy one is the hook's, and waiting does not help.)
  sqlite3_busy_timeout(db_, faults == nullptr ? 5000 : 0);
  return Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;", "opening");
}

Status Ledger::Error(std::string_view operation) const {
  const int code = db_ == nullptr ? SQLITE_NOMEM : sqlite3_errcode(db_);
  const char* text = db_ == nullptr ? "out of memory" : sqlite3_errmsg(db_);
  switch (code) {
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
    case SQLITE_ERROR:
    case SQLITE_CONSTRAINT:
    case SQLITE_MISMATCH:
    case SQLITE_MISUSE:
      return DataLoss("{}: {}: is not a whole session journal ({})", path_.string(), operation,
                      text);
    default:
      return Unavailable("{}: {}: {}", path_.string(), operation, text);
  }
}

Status Ledger::Execute(const char* sql, std::string_view operation) {
  if (sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) != SQLITE_OK) return Error(operation);
  return OkStatus();
}

Status Ledger::InsertRows(const std::vector<FrameRecord>& rows) {
  std::string parameters = "?";
  for (int i = 1; i < kFrameColumnCount; ++i) parameters += ",?";
  Statement insert(db_,
                   fmt::format("INSERT INTO frame ({}) VALUES ({})", kFrameColumns, parameters));
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

Status Ledger::InsertEntries(const std::vector<JournalEntry>& entries) {
  if (entries.empty()) return OkStatus();
  Statement insert(db_, "INSERT INTO entry (kind, rig_ns, item, value, text) VALUES (?,?,?,?,?)");
  for (const JournalEntry& entry : entries) {
    if (!insert.ok()) return Error("preparing journal entries");
    Binder(insert.get())
        .Int(static_cast<int>(entry.kind))
        .Int(entry.rig_ns)
        .Int(entry.index)
        .Real(entry.value)
        .Text(entry.text);
    if (insert.Step() != SQLITE_DONE) {
      return Error(fmt::format("writing {} journal entries", entries.size()));
    }
    sqlite3_reset(insert.get());
  }
  return OkStatus();
}

Status Ledger::Commit(const std::vector<FrameRecord>& rows,
                      const std::vector<JournalEntry>& entries) {
  return Transact(fmt::format("committing {} ledger rows", rows.size()), [&] {
    MESORIG_RETURN_IF_ERROR(InsertRows(rows));
    return InsertEntries(entries);
  });
}

Status Ledger::Transact(std::string_view operation, const std::function<Status()>& body) {
  MESORIG_RETURN_IF_ERROR(Execute("BEGIN IMMEDIATE", "beginning a transaction"));
  Status status = body();
  if (status.ok()) status = Execute("COMMIT", operation);
  if (!status.ok()) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
  return status;
}

Status Ledger::WriteStart() {
  return Execute("UPDATE session SET end=0, reason='', starts=starts+1",
                 "opening the session's end again");
}

Status Ledger::WriteEnd(const SessionSummary& session, const JournalEntry& entry) {
  return Transact("writing the session's end", [&] {
    MESORIG_RETURN_IF_ERROR(UpdateEnd(session));
    return InsertEntries({entry});
  });
}

Status Ledger::UpdateEnd(const SessionSummary& session) {
  Statement update(db_,
                   "UPDATE session SET end=?, reason=?, deterministic=?, virtual_s=?, wall_s=?");
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

}  // namespace mesorig::daemon
