#pragma once
// A connection to a session's `journal.sqlite`: the session record and the frame ledger.
// WAL with synchronous=FULL: what Commit and WriteEnd returned OK for survives a kill and a power
// cut. A live session holds two, one of its writer thread and one for readers; neither blocks the
// other. One connection is for one thread at a time.

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace mesorig::daemon {

class Ledger {
 public:
  static constexpr int kSchemaVersion = 2;

  // A new journal with its session record (end open).
  static StatusOr<std::unique_ptr<Ledger>> Create(const std::filesystem::path& path,
                                                  const SessionSummary& session);
  // NotFound without the file, DataLoss for one that is no journal or a damaged one,
  // FailedPrecondition for another schema version.
  static StatusOr<std::unique_ptr<Ledger>> Open(const std::filesystem::path& path);
  ~Ledger();
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  // All rows in one transaction, or none. Unavailable names the file and the operation.
  Status Commit(const std::vector<FrameRecord>& rows);
  // end, reason, deterministic, virtual_s and wall_s of the session record.
  Status WriteEnd(const SessionSummary& session);
  // Moves the WAL into the main file, so that an ended session is one file.
  Status Checkpoint();

  // frames_durable is the number of rows.
  StatusOr<SessionSummary> ReadSummary();
  StatusOr<std::optional<FrameRecord>> Find(int camera, uint64_t sequence);
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
  // By camera, then by sequence number; stops at the first error.
  Status ForEach(const std::function<Status(const FrameRecord&)>& visit);

 private:
  explicit Ledger(std::filesystem::path path) : path_(std::move(path)) {}
  Status Connect(int flags);
  Status Execute(const char* sql, std::string_view operation);
  Status Error(std::string_view operation) const;
  Status InsertRows(const std::vector<FrameRecord>& rows);
  StatusOr<int> UserVersion();

  std::filesystem::path path_;
  sqlite3* db_ = nullptr;
  sqlite3_stmt* find_ = nullptr;  // prepared once: every frame that leaves asks for its row
};

}  // namespace mesorig::daemon
