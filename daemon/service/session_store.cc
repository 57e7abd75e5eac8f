#include "daemon/service/session_store.h"

#include "protocol/base/log.h"

namespace mesorig::daemon {

SessionStore::SessionStore(std::filesystem::path root) : root_(std::move(root)) {
  const auto removed = RemoveUnfinished(root_);
  if (!removed.ok()) {
    Log("session").warn("{}", Message(removed.status()));
  } else if (*removed > 0) {
    Log("session").info("{}: {} unfinished sessions were removed", root_.string(), *removed);
  }
}

void SessionStore::SetCurrent(std::shared_ptr<Session> session) {
  MutexLock lock(mutex_);
  if (current_ && current_->id() != session->id()) opened_[current_->id()] = current_;
  opened_.erase(session->id());  // opened before it was resumed
  current_ = std::move(session);
}

StatusOr<std::shared_ptr<Session>> SessionStore::Create(const CompiledPlan& plan, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session, Session::Create(root_, plan, rig));
  SetCurrent(session);
  return session;
}

StatusOr<std::shared_ptr<Session>> SessionStore::Resume(const std::string& id, const Rig& rig,
                                                        ShotSelection again) {
  SessionOptions options;
  options.again = std::move(again);
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session,
                           Session::Resume(root_, id, rig, std::move(options)));
  SetCurrent(session);
  return session;
}

void SessionStore::Discard(const std::shared_ptr<Session>& session, std::string_view reason) {
  const Status ended = session->Finish(false, reason, 0, 0, true);
  if (!ended.ok()) Log("session").error("session {}: {}", session->id(), Message(ended));
  MutexLock lock(mutex_);
  if (current_ == session) current_.reset();
  std::error_code error;
  std::filesystem::remove_all(root_ / session->id(), error);
  if (error) Log("session").error("session {}: removing it: {}", session->id(), error.message());
}

StatusOr<std::shared_ptr<Session>> SessionStore::Find(const std::string& id) {
  MutexLock lock(mutex_);
  if (current_ && current_->id() == id) return current_;
  std::erase_if(opened_, [](const auto& entry) { return entry.second.expired(); });
  if (const auto found = opened_.find(id); found != opened_.end()) {
    if (std::shared_ptr<Session> session = found->second.lock()) return session;
  }
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session, Session::Open(root_, id));
  opened_[id] = session;
  return session;
}

std::shared_ptr<Session> SessionStore::Current() const {
  MutexLock lock(mutex_);
  return current_;
}

bool SessionStore::IsLive(const Session& session) const {
  MutexLock lock(mutex_);
  return current_.get() == &session && session.Summary().end == SessionEnd::kOpen;
}

uint32_t SessionStore::FramesPlanned(const std::string& id) const {
  MutexLock lock(mutex_);
  return current_ && current_->id() == id ? current_->Summary().frames_planned : 0;
}

StatusOr<std::vector<SessionInfo>> SessionStore::Describe() const {
  MESORIG_ASSIGN_OR_RETURN(const std::vector<std::string> ids, List());
  std::vector<SessionInfo> sessions;
  for (const std::string& id : ids) {
    auto info = DescribeSession(root_, id);
    if (absl::IsNotFound(info.status())) continue;
    MESORIG_RETURN_IF_ERROR(info.status());
    sessions.push_back(*std::move(info));
  }
  return sessions;
}

StatusOr<uint64_t> SessionStore::Remove(const std::string& id) {
  MESORIG_ASSIGN_OR_RETURN(const uint64_t bytes, RemoveSession(root_, id));
  MutexLock lock(mutex_);
  opened_.erase(id);
  if (current_ && current_->id() == id) current_ = nullptr;
  return bytes;
}

}  // namespace mesorig::daemon
