#pragma once
// A connection to a session's `journal.sqlite`: the session record, the frame ledger and the
// journal's entries. WAL with synchronous=FULL: what Commit, WriteStart and WriteEnd returned OK
// for survives a kill and a power cut. A live session holds two, one of its writer thread and one
// for readers; neither blocks the other. One connection is for one thread at a time. Errors:
// Unavailable names file and operation (full, read-only, failing or busy: it may be tried again);
// DataLoss is for good.

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "daemon/session/journal_vfs.h"
#include "daemon/session/session.h"
#include "protocol/base/disk_faults.h"
#include "protocol/base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace mesorig::daemon {

class Ledger {
 public:
  // A new journal with its session record (end open). `faults`: may be null; borrowed.
  static StatusOr<std::unique_ptr<Ledger>> Create(const std::filesystem::path& path,
                                                  const SessionSummary& session,
                                                  DiskFaults* faults = nullptr);
  // Brings an older journal to today's version. NotFound without the file, DataLoss for one that is
  // no journal or a damaged one, FailedPrecondition for a newer version.
  static StatusOr<std::unique_ptr<Ledger>> Open(const std::filesystem::path& path,
                                                DiskFaults* faults = nullptr);
  ~Ledger();
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // All rows and entries in one transaction, or none.
  Status Commit(const std::vector<FrameRecord>& rows, const std::vector<JournalEntry>& entries);
  // One more start of the session: its end is open again, `starts` is one more.
  Status WriteStart();
  // end, reason, deterministic, virtual_s and wall_s of the session record, with the journal's last
  // entry, in one transaction.
  Status WriteEnd(const SessionSummary& session, const JournalEntry& entry);
  // Moves the WAL into the main file, so that an ended session is one file.
  Status Checkpoint();

  // frames_durable is the number of rows.
  StatusOr<SessionSummary> ReadSummary();
  // In order of time.
  StatusOr<std::vector<JournalEntry>> ReadEntries();
  StatusOr<std::optional<FrameRecord>> Find(int camera, uint64_t sequence);
  // The last row of this camera and shot: its sequence number, 0: none.
  StatusOr<uint64_t> LastOfShot(int camera, uint32_t shot);
  // The last row of the stretch that begins with `row`, all of its camera and its segment.
  StatusOr<uint64_t> LastOfStretch(const FrameRecord& row);
  // Of the rows of `camera` in `segment` with shots first .. first + count - 1.
  struct Coverage {
    uint32_t shots = 0;       // different ones
    uint64_t last_bytes = 0;  // largest offset + bytes; 0: no rows
  };
  StatusOr<Coverage> Cover(int camera, uint32_t segment, uint32_t first, uint32_t count);
  // Highest sequence number of each camera; 0: none.
  StatusOr<std::vector<uint64_t>> LastSequences(int cameras);
  // What a resume needs of every row, by camera, then by sequence number; stops at the first error.
  struct Place {
    int camera = 0;
    uint64_t sequence = 0;
    uint32_t shot = 0, segment = 0;
    uint64_t offset = 0, bytes = 0;
  };
  Status ForEachPlace(const std::function<Status(const Place&)>& visit);
  // By camera, then by sequence number; stops at the first error.
  Status ForEach(const std::function<Status(const FrameRecord&)>& visit);
  // The last row of each camera and shot, in that order; stops at the first error.
  Status ForEachLive(const std::function<Status(const FrameRecord&)>& visit);

 private:
  explicit Ledger(std::filesystem::path path) : path_(std::move(path)) {}
  Status Connect(int flags, DiskFaults* faults);
  Status Execute(const char* sql, std::string_view operation);
  Status Error(std::string_view operation) const;
  Status InsertRows(const std::vector<FrameRecord>& rows);
  Status InsertEntries(const std::vector<JournalEntry>& entries);
  Status UpdateEnd(const SessionSummary& session);
  // All of it, or nothing.
  Status Transact(std::string_view operation, const std::function<Status()>& body);

  std::filesystem::path path_;
  std::unique_ptr<JournalVfs> vfs_;  // only with faults
  sqlite3* db_ = nullptr;
  sqlite3_stmt* find_ = nullptr;  // prepared once: every frame that leaves asks for its row
};

}  // namespace mesorig::daemon
