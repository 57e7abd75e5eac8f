#pragma once
// The sessions of one daemon: the one that it writes, and those on disk.

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "daemon/session/housekeeping.h"
#include "daemon/session/session.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Thread-safe. Sessions are shared: a consumer reads while the sequencer writes.
class SessionStore {
 public:
  // Removes what a kill left of sessions that were being created or removed.
  explicit SessionStore(std::filesystem::path root);
  // A new session; it becomes the one that is written.
  StatusOr<std::shared_ptr<Session>> Create(const CompiledPlan& plan, const Rig& rig);
  // One that was killed or ended incomplete becomes the one that is written; whoever subscribes to
  // it, or does so already, gets its further frames. `again`: as SessionOptions. Errors of
  // Session::Resume.
  StatusOr<std::shared_ptr<Session>> Resume(const std::string& id, const Rig& rig,
                                            ShotSelection again = {});
  // Ends a session that never began and removes it: nothing of it is left behind.
  void Discard(const std::shared_ptr<Session>& session, std::string_view reason);
  // NotFound for an unknown id; errors of Session::Open.
  StatusOr<std::shared_ptr<Session>> Find(const std::string& id);
  // The one that is written, or was last; null: none.
  std::shared_ptr<Session> Current() const;
  // More frames may come: this daemon writes it, and it has not ended. (A session whose end is open
  // although nobody writes it was killed.)
  bool IsLive(const Session& session) const;
  // Of a session that this daemon writes or wrote last; 0 for any other.
  uint32_t FramesPlanned(const std::string& id) const;
  StatusOr<std::vector<std::string>> List() const { return ListSessions(root_); }
  // Oldest first; one that vanishes meanwhile is left out.
  StatusOr<std::vector<SessionInfo>> Describe() const;
  // FailedPrecondition for one that is written. Returns the bytes freed.
  StatusOr<uint64_t> Remove(const std::string& id);
  // Bytes that the disk of the sessions still takes; nothing when it does not tell.
  std::optional<uint64_t> FreeBytes() const {
    const auto bytes = daemon::FreeBytes(root_);
    return bytes.ok() ? std::optional(*bytes) : std::nullopt;
  }
  const std::filesystem::path& root() const { return root_; }

 private:
  // `session` is from now on the one that is written.
  void SetCurrent(std::shared_ptr<Session> session) EXCLUDES(mutex_);

  const std::filesystem::path root_;
  mutable Mutex mutex_;
  std::shared_ptr<Session> current_ GUARDED_BY(mutex_);
  std::map<std::string, std::weak_ptr<Session>> opened_ GUARDED_BY(mutex_);  // while somebody reads
};

}  // namespace mesorig::daemon
