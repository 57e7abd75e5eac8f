#pragma once
// SQLite's way to the disk with the hook of protocol/base/disk_faults.h in between: every write,
// sync, truncation and removal of the journal's files is asked for.

#include <memory>
#include <string>

#include "protocol/base/disk_faults.h"

struct sqlite3_vfs;

namespace mesorig::daemon {

// Registered while it lives; the connections that use it are closed before.
class JournalVfs {
 public:
  // Null: SQLite has no VFS of its own.
  static std::unique_ptr<JournalVfs> Register(DiskFaults& faults);
  ~JournalVfs();
  JournalVfs(const JournalVfs&) = delete;
  JournalVfs& operator=(const JournalVfs&) = delete;
  const char* name() const { return name_.c_str(); }

 private:
  JournalVfs();
  std::string name_;
  std::unique_ptr<sqlite3_vfs> vfs_;
};

}  // namespace mesorig::daemon
