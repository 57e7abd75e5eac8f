#pragma once
// Internal to processing/service: the sessions that this process knows, and the Processing service
// that tells of them.

#include <map>
#include <memory>
#include <string>

#include "processing/service/session_job.h"
#include "protocol/messages/processing.grpc.pb.h"

namespace mesorig::service {

// Thread-safe.
class JobTable final : public v1::Processing::Service {
 public:
  explicit JobTable(JobOptions options) : options_(std::move(options)) {}
  // Begins the session unless it is known or its product exists.
  void StartIfNew(const std::string& session_id);
  // Also begins one again that failed.
  void Start(const std::string& session_id);
  // Ends all jobs and lets AwaitProducts return; nothing begins after it.
  void Stop();

  grpc::Status GetProducts(grpc::ServerContext* context, const v1::ProductsRequest* request,
                           v1::ProductsReply* reply) override;
  // Begins a session that is not known yet.
  grpc::Status AwaitProducts(grpc::ServerContext* context, const v1::ProductsRequest* request,
                             v1::ProductsReply* reply) override;

 private:
  void StartLocked(const std::string& session_id) REQUIRES(mutex_);
  // A product of an earlier run of this program.
  bool OnDisk(const std::string& session_id, v1::ProductsReply* reply) const;

  const JobOptions options_;
  ComputeSlots slots_{kComputeThreads};
  Mutex mutex_;
  CondVar changed_;
  bool stopped_ GUARDED_BY(mutex_) = false;
  std::map<std::string, std::shared_ptr<SessionJob>> jobs_ GUARDED_BY(mutex_);  // shared with calls
};

}  // namespace mesorig::service
