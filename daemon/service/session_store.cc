#include "daemon/service/session_store.h"

namespace mesorig::daemon {

StatusOr<std::shared_ptr<Session>> SessionStore::Create(const CompiledPlan& plan, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session, Session::Create(root_, plan, rig));
  MutexLock lock(mutex_);
  if (current_) opened_[current_->id()] = current_;
  current_ = session;
  return session;
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

bool SessionStore::IsLive(const Session& session) const {
  MutexLock lock(mutex_);
  return current_.get() == &session && session.Summary().end == SessionEnd::kOpen;
}

uint32_t SessionStore::FramesPlanned(const std::string& id) const {
  MutexLock lock(mutex_);
  return current_ && current_->id() == id ? current_->Summary().frames_planned : 0;
}

}  // namespace mesorig::daemon
