#pragma once
// The audit log of one daemon: who did what, when, from where, with which outcome (docs/audit.md).
// One file that only grows, audit.jsonl in the state folder, chained as protocol/base/hash_chain.h
// says. One thread writes it.

#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "daemon/service/caller.h"
#include "protocol/base/disk_faults.h"
#include "protocol/base/hash_chain.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

inline constexpr std::string_view kAuditFile = "audit.jsonl";

struct AuditEntry {
  Caller caller;
  std::string call;     // "Control/Run"; what the daemon does by itself: "daemon/opened"
  std::string what;     // the request's essential fields; at most kMaxWhat bytes are kept
  std::string outcome;  // "OK", or "FAILED_PRECONDITION: why"
};

struct AuditOptions {
  uint64_t anchor_every = 100;           // entries
  std::chrono::milliseconds retry{500};  // of a disk that takes nothing
  size_t waiting_limit = 10000;          // entries; what is over is counted
  std::function<double()> rig_s = [] { return 0.0; };
  std::function<void(std::string_view)> anchor;  // notes a line elsewhere; none: SystemAnchor
  std::function<std::chrono::system_clock::time_point()> utc = std::chrono::system_clock::now;
  DiskFaults* faults = nullptr;  // borrowed
};

// Thread-safe.
class AuditLog {
 public:
  static constexpr size_t kMaxWhat = 2048;  // bytes of `what` and of `outcome`

  // Opens or begins the log of a state folder. The whole chain is read first: the beginning of an
  // entry that a kill left is dropped, and an entry says so; a file that was tampered with is
  // renamed (audit.jsonl.damaged-<time>) and a new chain begins, whose first entry names the
  // damage. Unavailable: the file.
  static StatusOr<std::unique_ptr<AuditLog>> Open(const std::filesystem::path& state_dir,
                                                  AuditOptions options = {});
  ~AuditLog();  // writes what waits, and anchors the head

  // Returns when the entry is durable. Unavailable when the disk takes nothing: the entry waits in
  // memory, and the writer tries again.
  Status Record(AuditEntry entry) EXCLUDES(mutex_);
  // Never waits for the disk: of Stop.
  void RecordLater(AuditEntry entry) EXCLUDES(mutex_);
  // Notes the head elsewhere once everything recorded before is durable; does not wait.
  void Anchor() EXCLUDES(mutex_);

  ChainHead head() const EXCLUDES(mutex_);  // durable
  // Why nothing can be recorded; OK: it can. A daemon that cannot record starts nothing.
  Status health() const EXCLUDES(mutex_);
  // Bytes of durable whole entries from `offset` on, at most `limit`; empty: there are no more.
  StatusOr<std::string> Read(uint64_t offset, size_t limit) const EXCLUDES(mutex_);

 private:
  AuditLog(int file, std::filesystem::path path, ChainReport report, AuditOptions options);
  // Its number, by which `written_` says that it is durable; 0: there is no room for it.
  uint64_t Enqueue(std::string fields) REQUIRES(mutex_);
  std::string Fields(const AuditEntry& entry) const;
  void Loop() EXCLUDES(mutex_);
  // Writes a batch and syncs; false, and nothing of it is there, when the disk takes nothing.
  bool WriteBatch(std::deque<std::string>& batch) EXCLUDES(mutex_);
  Status Write(const std::string& lines, uint64_t at);
  void TellAnchor(const ChainHead& head);

  const int file_;
  const std::filesystem::path path_;
  const AuditOptions options_;
  uint64_t anchored_ = 0;  // sequence; of the writer's thread
  mutable Mutex mutex_;
  mutable CondVar changed_;
  std::deque<std::string> waiting_ GUARDED_BY(mutex_);  // fields: JSON members
  uint64_t enqueued_ GUARDED_BY(mutex_) = 0, written_ GUARDED_BY(mutex_) = 0;
  uint64_t failures_ GUARDED_BY(mutex_) = 0;  // attempts to write that failed
  uint64_t lost_ GUARDED_BY(mutex_) = 0;      // over the limit, since the last that was kept
  Status health_ GUARDED_BY(mutex_);
  ChainHead head_ GUARDED_BY(mutex_);
  uint64_t bytes_ GUARDED_BY(mutex_);
  bool anchor_asked_ GUARDED_BY(mutex_) = false, ending_ GUARDED_BY(mutex_) = false;
  std::thread writer_;
};

// To the system's journal by syslog(3), facility authpriv.
void SystemAnchor(std::string_view line);

}  // namespace mesorig::daemon
