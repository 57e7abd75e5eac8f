#include "daemon/session/session_folder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>

#include "daemon/session/ledger.h"
#include "daemon/session/segment.h"
#include "protocol/base/file_writer.h"

namespace mesorig::daemon {
namespace {

constexpr size_t kMaxName = 100;

bool IsNameCharacter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == '-';
}

std::string MakeId(std::chrono::system_clock::time_point when, std::string_view plan_name) {
  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(when.time_since_epoch());
  const auto seconds = static_cast<time_t>(ms.count() / 1000);
  std::tm utc{};
  ::gmtime_r(&seconds, &utc);
  char stamp[32];
  std::strftime(stamp, sizeof(stamp), "%Y%m%dT%H%M%S", &utc);
  std::string name(plan_name.substr(0, kMaxName));
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !IsNameCharacter(c); }, '-');
  return fmt::format("{}.{:03}Z-{}", stamp, ms.count() % 1000, name);
}

// For fcntl: a lock of an open file, as flock's, that one can ask about without taking it.
struct flock WholeFile() {
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

// Unavailable; AlreadyExists.
Status MakeFolder(const std::filesystem::path& dir, DiskFaults* faults) {
  int error = AskDisk(faults, DiskOperation::kMakeFolder, dir);
  if (error == 0 && ::mkdir(dir.c_str(), 0755) != 0) error = errno;
  if (error == 0) return OkStatus();
  if (error == EEXIST) return absl::AlreadyExistsError(dir.string());
  return Unavailable("{}: cannot be created: {}", dir.string(), strerror(error));
}

Status RenameFolder(const std::filesystem::path& from, const std::filesystem::path& to,
                    DiskFaults* faults) {
  int error = AskDisk(faults, DiskOperation::kRename, to);
  if (error == 0 && ::rename(from.c_str(), to.c_str()) != 0) error = errno;
  if (error == 0) return OkStatus();
  return Unavailable("{}: rename: {}", to.string(), strerror(error));
}

Status FillFolder(const SessionFolder& folder, const Rig& rig, std::string_view plan_bin,
                  const SessionSummary& session, DiskFaults* faults) {
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder.plan(), plan_bin));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(folder.rig(), rig.source_text));
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    const std::string& name = rig.cameras[i].name;
    if (!IsFileName(name)) {
      return InvalidArgument(
          "camera name \"{}\" cannot be a file name: letters, digits, '.', '_' "
          "and '-' can",
          name);
    }
    MESORIG_ASSIGN_OR_RETURN(
        SegmentWriter segment,
        SegmentWriter::Open(folder.segment(name), static_cast<int>(i), name, 0, faults));
    MESORIG_RETURN_IF_ERROR(segment.Sync());
  }
  MESORIG_RETURN_IF_ERROR(MakeFolder(folder.sweeps(), faults));
  MESORIG_ASSIGN_OR_RETURN(const auto ledger, Ledger::Create(folder.journal(), session, faults));
  MESORIG_RETURN_IF_ERROR(ledger->Checkpoint());
  return SyncFolder(folder.dir(), faults);
}

}  // namespace

StatusOr<UniqueFd> LockSession(const SessionFolder& folder) {
  UniqueFd fd(::open(folder.plan().c_str(), O_RDWR | O_CLOEXEC));
  if (fd.get() < 0) {
    return Unavailable("{}: cannot be opened for writing: {}", folder.plan().string(),
                       strerror(errno));
  }
  struct flock lock = WholeFile();
  if (::fcntl(fd.get(), F_OFD_SETLK, &lock) != 0) {
    if (errno == EAGAIN || errno == EACCES) {
      return FailedPrecondition("session {} is being written", folder.dir().filename().string());
    }
    return Unavailable("{}: cannot be locked: {}", folder.plan().string(), strerror(errno));
  }
  return fd;
}

bool IsLocked(const SessionFolder& folder) {
  const UniqueFd fd(::open(folder.plan().c_str(), O_RDONLY | O_CLOEXEC));
  struct flock lock = WholeFile();
  return fd.get() >= 0 && ::fcntl(fd.get(), F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

Status SyncFolder(const std::filesystem::path& dir, DiskFaults* faults) {
  int error = AskDisk(faults, DiskOperation::kSync, dir);
  const UniqueFd fd(::open(dir.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (error == 0 && (fd.get() < 0 || ::fsync(fd.get()) != 0)) error = errno;
  return error == 0 ? OkStatus() : Unavailable("{}: fsync: {}", dir.string(), strerror(error));
}

bool IsFileName(std::string_view name) {
  return !name.empty() && name.size() <= 2 * kMaxName && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), IsNameCharacter);
}

StatusOr<SessionFolder> CreateSessionFolder(const std::filesystem::path& root, const Rig& rig,
                                            std::string_view plan_bin, SessionSummary& session,
                                            DiskFaults* faults) {
  std::error_code error;
  std::filesystem::create_directories(root, error);
  if (error) return Unavailable("{}: cannot be created: {}", root.string(), error.message());
  auto when = std::chrono::system_clock::now();
  for (int attempt = 0; attempt < 1000; ++attempt, when += std::chrono::milliseconds(1)) {
    session.id = MakeId(when, session.plan_name);
    const std::filesystem::path final_dir = root / session.id;
    const SessionFolder part(root / fmt::format(".{}.part", session.id));
    if (std::filesystem::exists(final_dir, error)) continue;
    Status status = MakeFolder(part.dir(), faults);
    if (absl::IsAlreadyExists(status)) continue;
    MESORIG_RETURN_IF_ERROR(status);
    status = FillFolder(part, rig, plan_bin, session, faults);
    if (status.ok()) status = RenameFolder(part.dir(), final_dir, faults);
    if (!status.ok()) {
      if (AskDisk(faults, DiskOperation::kRemove, part.dir()) == 0) {
        std::filesystem::remove_all(part.dir(), error);
      }
      return status;
    }
    MESORIG_RETURN_IF_ERROR(SyncFolder(root, faults));
    return SessionFolder(final_dir);
  }
  return Unavailable("{}: no free session id", root.string());
}

StatusOr<std::vector<std::string>> ListSessions(const std::filesystem::path& root) {
  std::vector<std::string> ids;
  std::error_code error;
  if (!std::filesystem::exists(root, error)) return ids;
  std::filesystem::directory_iterator entries(root, error);
  if (error) return Unavailable("{}: cannot be listed: {}", root.string(), error.message());
  for (const auto& entry : entries) {
    const std::string id = entry.path().filename().string();
    if (IsFileName(id) && std::filesystem::exists(SessionFolder(entry.path()).journal(), error)) {
      ids.push_back(id);
    }
  }
  std::sort(ids.begin(), ids.end());  // ids begin with their time
  return ids;
}

}  // namespace mesorig::daemon
