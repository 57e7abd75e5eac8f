#include "processing/service/job_table.h"

#include "processing/service/product_folder.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::service {

void JobTable::StartLocked(const std::string& session_id) {
  if (stopped_) return;
  jobs_[session_id] = start_job_(session_id, [this] {
    MutexLock lock(mutex_);
    changed_.NotifyAll();
  });
}

void JobTable::Start(const std::string& session_id) {
  if (!CheckSessionId(session_id).ok()) return;
  const std::optional<uint32_t> starts = ask_starts_(session_id);
  const auto current = [&](uint32_t start) { return !starts || *starts == start; };
  std::shared_ptr<Job> before;  // ends outside the lock, which its thread may take
  {
    MutexLock lock(mutex_);
    const auto found = jobs_.find(session_id);
    if (found != jobs_.end()) {
      const Job& job = *found->second;
      if (!job.finished() || (!job.failed() && current(job.start()))) return;
    } else if (OnDisk(session_id, nullptr) &&
               current(StartOfProducts(products_dir_ / session_id))) {
      return;
    }
    if (found != jobs_.end()) before = std::move(found->second);
    StartLocked(session_id);
  }
}

void JobTable::Stop() {
  std::map<std::string, std::shared_ptr<Job>> jobs;
  {
    MutexLock lock(mutex_);
    stopped_ = true;
    jobs.swap(jobs_);
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
    if (const auto found = jobs_.find(id); found != jobs_.end()) job = found->second;
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
  Start(id);
  std::shared_ptr<Job> job;
  {
    MutexLock lock(mutex_);
    if (const auto found = jobs_.find(id); found != jobs_.end()) job = found->second;
    while (job != nullptr && !job->finished() && !stopped_ && !context->IsCancelled()) {
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
