// Events, over breaks of the connection and restarts of the daemon; and the audit log's bytes.

#include <chrono>
#include <thread>

#include "client/connection/daemon_calls.h"

namespace mesorig::client {
namespace {

using HostClock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kRetry{200};

Status Gone(const grpc::Status& status) {
  if (status.ok()) return Unavailable("mesorigd ended the stream of events");
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
    return Unavailable("mesorigd is gone: {}", status.error_message());
  }
  return wire::FromGrpc(status);
}

}  // namespace

Status DaemonClient::Watch(uint64_t after_sequence,
                           const std::function<bool(const v1::Event&)>& on_event,
                           double patience_s) {
  v1::WatchRequest request;
  request.set_after_sequence(after_sequence);
  request.set_life(state_->hello.life());
  auto heard = HostClock::now();
  for (;;) {
    grpc::ClientContext context;
    const auto stream = state_->control->Watch(&context, request);
    v1::Event event;
    while (stream->Read(&event)) {
      heard = HostClock::now();
      request.set_after_sequence(event.sequence());
      request.set_life(event.life());
      if (on_event(event)) continue;
      context.TryCancel();
      stream->Finish();
      return OkStatus();
    }
    const Status gone = Gone(stream->Finish());
    const std::chrono::duration<double> silent = HostClock::now() - heard;
    if (!absl::IsUnavailable(gone) || silent.count() >= patience_s) return gone;
    std::this_thread::sleep_for(kRetry);
  }
}

Status DaemonClient::ReadAudit(uint64_t offset,
                               const std::function<void(std::string_view)>& on_bytes) {
  grpc::ClientContext context;
  v1::ReadAuditRequest request;
  request.set_offset(offset);
  const auto stream = state_->control->ReadAudit(&context, request);
  v1::AuditBytes bytes;
  while (stream->Read(&bytes)) on_bytes(bytes.data());
  return wire::FromGrpc(stream->Finish());
}

}  // namespace mesorig::client
