#include "daemon/session/released_sweeps.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>

#include "protocol/base/file_writer.h"

namespace mesorig::daemon {
namespace {

constexpr size_t kMaxMark = 4096;

std::string MarkText(std::string_view session_id, uint32_t sweep) {
  return fmt::format("mesorig: the raw frames of sweep {} of session {} were released\n", sweep,
                     session_id);
}

// The sweep that a file of this name would mark.
std::optional<uint32_t> SweepOfMark(const SessionFolder& folder, const std::string& name) {
  uint32_t sweep = 0;
  const char* end = name.data() + name.size();
  if (std::from_chars(name.data(), end, sweep).ec != std::errc()) return std::nullopt;
  // (Sweep + 1 is a segment's number.)
  if (sweep == UINT32_MAX || folder.release_mark(sweep).filename() != name) return std::nullopt;
  return sweep;
}

}  // namespace

Status MarkReleased(const SessionFolder& folder, std::string_view session_id, uint32_t sweep) {
  return WriteFileAtomically(folder.release_mark(sweep), MarkText(session_id, sweep));
}

bool IsMarkedReleased(const SessionFolder& folder, std::string_view session_id, uint32_t sweep) {
  const auto text = ReadFile(folder.release_mark(sweep), kMaxMark);
  return text.ok() && *text == MarkText(session_id, sweep);
}

std::set<uint32_t> FindReleased(const SessionFolder& folder, std::string_view session_id) {
  std::set<uint32_t> released;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder.sweeps(), error), end; !error && at != end;
       at.increment(error)) {
    const auto sweep = SweepOfMark(folder, at->path().filename().string());
    if (sweep && IsMarkedReleased(folder, session_id, *sweep)) released.insert(*sweep);
  }
  return released;
}

StatusOr<uint64_t> RemoveSweepSegments(const SessionFolder& folder,
                                       const std::vector<std::string>& cameras, uint32_t sweep) {
  uint64_t freed = 0;
  for (const std::string& camera : cameras) {
    const std::filesystem::path path = folder.segment(camera, sweep + 1);
    struct stat info {};
    const bool known = ::lstat(path.c_str(), &info) == 0;
    if (known && ::unlink(path.c_str()) == 0) {
      freed += static_cast<uint64_t>(info.st_size);
    } else if (errno != ENOENT) {
      return Unavailable("{}: cannot be removed: {}", path.string(), strerror(errno));
    }
  }
  return freed;
}

}  // namespace mesorig::daemon
