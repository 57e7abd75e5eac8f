#pragma once
// The sessions of one daemon: the one that it writes, and those on disk.

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "daemon/session/session.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Thread-safe. Sessions are shared: a consumer reads while the sequencer writes.
class SessionStore {
 public:
  explicit SessionStore(std::filesystem::path root) : root_(std::move(root)) {}
  // A new session; it becomes the one that is written.
  StatusOr<std::shared_ptr<Session>> Create(const CompiledPlan& plan, const Rig& rig);
  // Goes on writing one that was killed or ended incomplete; it becomes the one that is written.
  // Errors of Session::Resume; FailedPrecondition for the one that is written now.
  StatusOr<std::shared_ptr<Session>> Resume(const std::string& id, const Rig& rig);
  // Ends a session that never began and removes it: nothing of it is left behind.
  void Discard(const std::shared_ptr<Session>& session, std::string_view reason);
  // Bytes that this process may still write there; nothing: it cannot be told.
  std::optional<uint64_t> FreeBytes() const;
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
