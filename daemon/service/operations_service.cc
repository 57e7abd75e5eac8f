#include "daemon/service/operations_service.h"

#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {

void OperationsService::OnDiagnose(std::function<std::vector<DiagnosticFile>()> collect) {
  MutexLock lock(mutex_);
  collect_ = std::move(collect);
}

grpc::Status OperationsService::Diagnose(grpc::ServerContext*, const v1::DiagnoseRequest*,
                                         v1::DiagnoseReply* reply) {
  MutexLock lock(mutex_);
  if (!collect_) return wire::ToGrpc(Unavailable("mesorigd has nothing to tell yet"));
  for (DiagnosticFile& file : collect_()) {
    v1::DiagnosticText& text = *reply->add_texts();
    text.set_name(std::move(file.name));
    text.set_content(std::move(file.content));
  }
  return grpc::Status::OK;
}

}  // namespace mesorig::daemon
