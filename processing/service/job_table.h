#pragma once
// Internal to processing/service: the sessions that this process knows, and the Processing service
// that tells of them.

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "protocol/base/mutex.h"
#include "protocol/messages/processing.grpc.pb.h"

namespace mesorig::service {

// What becomes of one session; it begins with the object. Thread-safe.
class Job {
 public:
  virtual ~Job() = default;  // stops it and waits
  virtual void Stop() = 0;
  // As the Processing service tells it.
  virtual v1::ProductsReply Snapshot() const = 0;
  virtual bool finished() const = 0;  // done, or failed
  virtual bool failed() const = 0;
  virtual uint32_t start() const = 0;  // of the session, that it was finished with
};
// `on_change` is called, without a lock, whenever Snapshot() has changed for good.
using StartJob = std::function<std::shared_ptr<Job>(const std::string& session_id,
                                                    std::function<void()> on_change)>;
// How often a session began, its resumes included; nothing: nobody tells.
using AskStarts = std::function<std::optional<uint32_t>(const std::string& session_id)>;

// Thread-safe.
class JobTable final : public v1::Processing::Service {
 public:
  JobTable(std::filesystem::path products_dir, StartJob start_job, AskStarts ask_starts)
      : products_dir_(std::move(products_dir)),
        start_job_(std::move(start_job)),
        ask_starts_(std::move(ask_starts)) {}
  // The daemon has begun this session, or resumed it. Begins it here too unless its product exists
  // or it is under way. One that failed begins again: a session that ended incomplete may have been
  // resumed. So does one that is about to fail, once it has, and one whose frames were taken again
  // since.
  void Start(const std::string& session_id);
  // Ends all jobs and lets AwaitProducts return; nothing begins after it.
  void Stop();

  grpc::Status GetProducts(grpc::ServerContext* context, const v1::ProductsRequest* request,
                           v1::ProductsReply* reply) override;
  // Begins a session that is not known yet, or failed.
  grpc::Status AwaitProducts(grpc::ServerContext* context, const v1::ProductsRequest* request,
                             v1::ProductsReply* reply) override;

 private:
  void Start(const std::string& session_id, bool began);
  void StartLocked(const std::string& session_id) REQUIRES(mutex_);
  void OnChange(const std::string& session_id);
  std::shared_ptr<Job> FindLocked(const std::string& session_id) const REQUIRES(mutex_);
  // A product of an earlier run of this program.
  bool OnDisk(const std::string& session_id, v1::ProductsReply* reply) const;

  const std::filesystem::path products_dir_;
  const StartJob start_job_;
  const AskStarts ask_starts_;
  Mutex mutex_;
  CondVar changed_;
  bool stopped_ GUARDED_BY(mutex_) = false;
  std::map<std::string, std::shared_ptr<Job>> jobs_ GUARDED_BY(mutex_);  // shared with calls
  std::set<std::string> again_ GUARDED_BY(mutex_);  // begun anew while their jobs still ran
  std::vector<std::shared_ptr<Job>> replaced_ GUARDED_BY(mutex_);  // by their own threads
};

}  // namespace mesorig::service
