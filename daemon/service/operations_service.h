#pragma once
// The Operations service (protocol/messages/operations.proto).

#include <functional>
#include <vector>

#include "daemon/service/daemon_service.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/operations.grpc.pb.h"

namespace mesorig::daemon {

// Thread-safe.
class OperationsService final : public v1::Operations::Service {
 public:
  void OnDiagnose(std::function<std::vector<DiagnosticFile>()> collect);
  grpc::Status Diagnose(grpc::ServerContext* context, const v1::DiagnoseRequest* request,
                        v1::DiagnoseReply* reply) override;

 private:
  Mutex mutex_;  // one at a time
  std::function<std::vector<DiagnosticFile>()> collect_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
