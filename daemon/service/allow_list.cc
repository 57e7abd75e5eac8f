#include "daemon/service/allow_list.h"

#include <sys/stat.h>

#include "protocol/base/file_writer.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {

std::set<std::string, std::less<>> ReadAllowed(std::string_view text) {
  std::set<std::string, std::less<>> found;
  while (!text.empty()) {
    const size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end == text.npos ? text.size() : end + 1);
    const std::string_view first = line.substr(0, line.find_first_of(" \t\r"));
    if (first.size() == 64 && first.find_first_not_of("0123456789abcdef") == first.npos) {
      found.emplace(first);
    }
  }
  return found;
}

AllowList::Stamp AllowList::Look() const {
  struct stat status {};
  if (::stat(file_.c_str(), &status) != 0) return {};
  return {status.st_mtim.tv_sec, status.st_mtim.tv_nsec, status.st_ino,
          static_cast<uint64_t>(status.st_size)};
}

void AllowList::Read(const Stamp& stamp) {
  stamp_ = stamp;
  const auto text = ReadFile(file_, kMaxBytes);
  fingerprints_ = text.ok() ? ReadAllowed(*text) : std::set<std::string, std::less<>>();
  if (text.ok()) {
    Log("access").info("{}: {} certificates may come in", file_.string(), fingerprints_.size());
  } else {
    Log("access").error("{}: nobody comes in over the network: {}", file_.string(),
                        Message(text.status()));
  }
}

bool AllowList::Allows(std::string_view fingerprint) {
  const Stamp now = Look();
  MutexLock lock(mutex_);
  if (now != stamp_) Read(now);
  return fingerprints_.contains(fingerprint);
}

void AllowList::Reload() {
  const Stamp now = Look();
  MutexLock lock(mutex_);
  Read(now);
}

}  // namespace mesorig::daemon
