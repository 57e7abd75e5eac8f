#pragma once
// What can go wrong with a disk, on purpose: whoever keeps something durable asks the hook before
// it touches the disk, so that tests see a full, read-only, failing, slow or dead one. In the
// product there is no hook.

#include <cstdint>
#include <filesystem>

namespace mesorig {

enum class DiskOperation : uint8_t {
  kCreate,  // a file
  kMakeFolder,
  kWrite,     // `bytes` at `offset`
  kTruncate,  // to `offset`
  kSync,      // of a file, or of a folder's entries
  kRename,
  kRemove,
};

struct DiskAccess {
  DiskOperation operation{};
  const std::filesystem::path& path;
  uint64_t offset = 0, bytes = 0;
};

// Thread-safe; borrowed by whoever writes, and outlives it.
class DiskFaults {
 public:
  virtual ~DiskFaults() = default;
  // Called before the operation, on the thread that would do it; may hold it up. 0: it is done. An
  // errno: it fails with that, and nothing is done, except that the first `*torn` bytes (0 when the
  // call begins) of what was to be written are.
  virtual int Before(const DiskAccess& access, uint64_t* torn) = 0;
};

// The same of a hook that may be null, for operations that cannot be torn.
inline int AskDisk(DiskFaults* faults, DiskOperation operation, const std::filesystem::path& path,
                   uint64_t offset = 0) {
  uint64_t torn = 0;
  return faults == nullptr ? 0 : faults->Before({operation, path, offset, 0}, &torn);
}

}  // namespace mesorig
