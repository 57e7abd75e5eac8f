#include "processing/service/job_table.h"

#include <utility>

#include "processing/service/product_folder.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::service {

void JobTable::StartLocked(const std::string& session_id) {
  if (stopped_) return;
  again_.erase(session_id);
  jobs_[session_id] = start_job_(session_id, [this, session_id] { OnChange(session_id); });
}

void JobTable::OnChange(const std::string& session_id) {
  MutexLock lock(mutex_);
  const std::shared_ptr<Job> job = FindLocked(session_id);
  if (job != nullptr && job->failed() && again_.contains(session_id)) {
    replaced_.push_back(job);  // ends on another thread than its own
    StartLocked(session_id);
  }
  changed_.NotifyAll();
}

std::shared_ptr<Job> JobTable::FindLocked(const std::string& session_id) const {
  const auto found = jobs_.find(session_id);
  return found == jobs_.end() ? nullptr : found->second;
}

void JobTable::Start(const std::string& session_id) { Start(session_id, true); }

void JobTable::Start(const std::string& session_id, bool began) {
  if (!CheckSessionId(session_id).ok()) return;
  const std::optional<uint32_t> starts = ask_starts_(session_id);
  const auto current = [&](uint32_t start) { return !starts || *starts == start; };
  std::vector<std::shared_ptr<Job>> before;  // end outside the lock, which their threads may take
  {
    MutexLock lock(mutex_);
    before = std::exchange(replaced_, {});
    const std::shared_ptr<Job> job = FindLocked(session_id);
    if (job != nullptr) {
      if (began && !job->finished()) again_.insert(session_id);
      if (!job->finished() || (!job->failed() && current(job->start()))) return;
    } else if (OnDisk(session_id, nullptr) &&
               current(StartOfProducts(products_dir_ / session_id))) {
      return;
    }
    before.push_back(job);
    StartLocked(session_id);
  }
}

void JobTable::Stop() {
  std::map<std::string, std::shared_ptr<Job>> jobs;
  std::vector<std::shared_ptr<Job>> replaced;
  {
    MutexLock lock(mutex_);
    stopped_ = true;
    jobs.swap(jobs_);
    replaced.swap(replaced_);
    changed_.NotifyAll();
  }
  for (auto& [id, job] : jobs) job->Stop();
}

bool JobTable::OnDisk(const std::string& session_id, v1::ProductsReply* reply) const {
  const std::vector<v1::Product> products = ProductsOnDisk(products_dir_ / session_id);
  if (products.empty()) return false;
  if (reply == nullptr) return true;
  reply->set_session_id(session_id);
  reply->set_done(true);
  for (const v1::Product& product : products) *reply->add_products() = product;
  return true;
}

grpc::Status JobTable::GetProducts(grpc::ServerContext*, const v1::ProductsRequest* request,
                                   v1::ProductsReply* reply) {
  const std::string& id = request->session_id();
  if (const Status status = CheckSessionId(id); !status.ok()) return wire::ToGrpc(status);
  std::shared_ptr<Job> job;
  {
    MutexLock lock(mutex_);
    job = FindLocked(id);
  }
  if (job != nullptr) {
    *reply = job->Snapshot();
  } else if (!OnDisk(id, reply)) {
    return wire::ToGrpc(NotFound("session {} is not known to mesorig-processd", id));
  }
  return grpc::Status::OK;
}

grpc::Status JobTable::AwaitProducts(grpc::ServerContext* context,
                                     const v1::ProductsRequest* request,
                                     v1::ProductsReply* reply) {
  const std::string& id = request->session_id();
  if (const Status status = CheckSessionId(id); !status.ok()) return wire::ToGrpc(status);
  Start(id, false);
  std::shared_ptr<Job> job;
  std::vector<std::shared_ptr<Job>> before;  // end outside the lock, which their threads may take
  {
    MutexLock lock(mutex_);
    for (;;) {
      std::shared_ptr<Job> found = FindLocked(id);
      if (job != nullptr && job != found) before.push_back(job);
      job = std::move(found);
      if (job == nullptr || job->finished() || stopped_ || context->IsCancelled()) break;
      changed_.WaitFor(mutex_, std::chrono::milliseconds(100));
    }
  }
  if (job == nullptr) {
    if (OnDisk(id, reply)) return grpc::Status::OK;
    return wire::ToGrpc(Unavailable("mesorig-processd is stopping"));
  }
  if (!job->finished()) return wire::ToGrpc(Unavailable("mesorig-processd is stopping"));
  *reply = job->Snapshot();
  return grpc::Status::OK;
}

}  // namespace mesorig::service
