#pragma once
// Records every call that CallTable() says is audited, whichever method it reaches: who, the
// request's essential fields, the outcome. Internal to the service.

#include <grpcpp/support/server_interceptor.h>

#include <memory>

#include "daemon/service/audit_log.h"

namespace google::protobuf {
class Message;
}

namespace mesorig::daemon {

// One line; a field of more than 200 bytes (a plan) is told by its SHA-256 and size.
std::string EssentialFields(const google::protobuf::Message& request);

// Borrows the log for the server's life. The entry is durable before the outcome is told; that of
// Stop, and of what the access check refuses, is queued.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> MakeAuditInterceptors(
    AuditLog& log);

// What the access check refused: at most 20 a second for long; of the others the next entry tells
// how many. Never waits. Thread-safe.
class RefusalRecorder {
 public:
  explicit RefusalRecorder(AuditLog& log) : log_(log) {}
  void Record(Caller caller, std::string_view path, const Status& why) EXCLUDES(mutex_);

 private:
  AuditLog& log_;
  Mutex mutex_;
  std::chrono::steady_clock::time_point refilled_ GUARDED_BY(mutex_);
  double tokens_ GUARDED_BY(mutex_) = 100;
  uint64_t passed_over_ GUARDED_BY(mutex_) = 0;
};

// "OK", or "FAILED_PRECONDITION: why".
std::string OutcomeText(const Status& status);

}  // namespace mesorig::daemon
