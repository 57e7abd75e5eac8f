#include "daemon/service/session_store.h"

#include <sys/statvfs.h>

#include "protocol/base/log.h"

namespace mesorig::daemon {

StatusOr<std::shared_ptr<Session>> SessionStore::Create(const CompiledPlan& plan, const Rig& rig) {
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session, Session::Create(root_, plan, rig));
  MutexLock lock(mutex_);
  if (current_) opened_[current_->id()] = current_;
  current_ = session;
  return session;
}

StatusOr<std::shared_ptr<Session>> SessionStore::Resume(const std::string& id, const Rig& rig) {
  MutexLock lock(mutex_);
  if (current_ && current_->id() == id && current_->Summary().end == SessionEnd::kOpen) {
    return FailedPrecondition("session {} is being written", id);
  }
  MESORIG_ASSIGN_OR_RETURN(std::shared_ptr<Session> session, Session::Resume(root_, id, rig));
  if (current_ && current_->id() != id) opened_[current_->id()] = current_;
  opened_.erase(id);  // who read the ended one reads on in it
  current_ = session;
  return session;
}

void SessionStore::Discard(const std::shared_ptr<Session>& session, std::string_view reason) {
  const Status ended = session->Finish(false, reason, 0, 0, true);
  if (!ended.ok()) spdlog::error("session {}: {}", session->id(), Message(ended));
  MutexLock lock(mutex_);
  if (current_ == session) current_.reset();
  std::error_code error;
  std::filesystem::remove_all(root_ / session->id(), error);
  if (error) spdlog::error("session {}: removing it: {}", session->id(), error.message());
}

std::optional<uint64_t> SessionStore::FreeBytes() const {
  // (The folder comes with the first session.)
  std::filesystem::path folder = root_;
  std::error_code error;
  while (!std::filesystem::exists(folder, error) && folder.has_relative_path()) {
    folder = folder.parent_path();
  }
  struct statvfs volume {};
  if (::statvfs(folder.empty() ? "." : folder.c_str(), &volume) != 0) return std::nullopt;
  return static_cast<uint64_t>(volume.f_bavail) * volume.f_frsize;
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
