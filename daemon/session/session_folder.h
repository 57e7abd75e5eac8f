#pragma once
// Where the files of a session are, and how a session's folder comes to be: built under a hidden
// name and renamed, so that a folder with a session's name is whole. docs/files.md has the layout.

#include <filesystem>
#include <string>
#include <string_view>

#include "daemon/session/segment.h"
#include "daemon/session/session.h"
#include "protocol/base/disk_faults.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

// Paths inside one session's folder.
class SessionFolder {
 public:
  explicit SessionFolder(std::filesystem::path dir) : dir_(std::move(dir)) {}
  const std::filesystem::path& dir() const { return dir_; }
  std::filesystem::path plan() const { return dir_ / "plan.bin"; }
  std::filesystem::path rig() const { return dir_ / "rig.toml"; }
  std::filesystem::path journal() const { return dir_ / "journal.sqlite"; }
  // 0: the camera's main segment; else of the sweep `segment - 1`, whose frames are not kept.
  std::filesystem::path segment(std::string_view camera_name, uint32_t segment = 0) const {
    if (segment == 0) return dir_ / (std::string(camera_name) + ".seg");
    return sweeps() / fmt::format("{:05}.{}.seg", segment - 1, camera_name);
  }
  std::filesystem::path sweeps() const { return dir_ / "sweeps"; }
  // There, and whole: the raw frames of that sweep were released.
  std::filesystem::path release_mark(uint32_t sweep) const {
    return sweeps() / fmt::format("{:05}.released", sweep);
  }

 private:
  std::filesystem::path dir_;
};

// Creates `<root>/<id>/` with plan.bin, rig.toml, a journal, an empty segment a camera and the
// folder for those of sweeps, all synced. The id is `YYYYMMDDTHHMMSS.mmmZ-<plan name>` (UTC), so
// that ids sort by age; characters of the plan's name that do not belong into a file name become
// '-'. Fills in session.id. InvalidArgument for a camera's name that cannot be a file name;
// Unavailable names the file and what failed, and nothing is left behind. `faults`: may be null.
StatusOr<SessionFolder> CreateSessionFolder(const std::filesystem::path& root, const Rig& rig,
                                            std::string_view plan_bin, SessionSummary& session,
                                            DiskFaults* faults = nullptr);

// Whoever writes the session holds this: FailedPrecondition when somebody else does. It goes with
// the descriptor, and with the process.
StatusOr<UniqueFd> LockSession(const SessionFolder& folder);
// Somebody writes it, here or in another process.
bool IsLocked(const SessionFolder& folder);

// fsync of the folder: files that were created in it are there after a power cut.
Status SyncFolder(const std::filesystem::path& dir, DiskFaults* faults = nullptr);

// Letters, digits, '.', '_' and '-', not beginning with '.': what an id or a camera's file may be
// called.
bool IsFileName(std::string_view name);

}  // namespace mesorig::daemon
