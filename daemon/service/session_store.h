#pragma once
// The sessions of one daemon: the one that it writes, and those on disk.

#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include "daemon/session/session.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Thread-safe. Sessions are shared: a consumer reads while the sequencer writes.
class SessionStore {
 public:
  explicit SessionStore(std::filesystem::path root) : root_(std::move(root)) {}
  // A new session; it becomes the one that is written.
  StatusOr<std::shared_ptr<Session>> Create(const CompiledPlan& plan, const Rig& rig);
  // NotFound for an unknown id; errors of Session::Open.
  StatusOr<std::shared_ptr<Session>> Find(const std::string& id);
  // More frames may come: this daemon writes it, and it has not ended. (A session whose end is open
  // although nobody writes it was killed.)
  bool IsLive(const Session& session) const;
  // Of a session that this daemon writes or wrote last; 0 for any other.
  uint32_t FramesPlanned(const std::string& id) const;
  StatusOr<std::vector<std::string>> List() const { return ListSessions(root_); }

 private:
  const std::filesystem::path root_;
  mutable Mutex mutex_;
  std::shared_ptr<Session> current_ GUARDED_BY(mutex_);
  std::map<std::string, std::weak_ptr<Session>> opened_ GUARDED_BY(mutex_);  // while somebody reads
};

}  // namespace mesorig::daemon
