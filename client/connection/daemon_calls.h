#pragma once
// Internal to client/connection: the calls of a DaemonClient.

#include <grpcpp/grpcpp.h>

#include "client/connection/daemon_client.h"
#include "protocol/messages/control.grpc.pb.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/messages/operations.grpc.pb.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::client {

inline constexpr auto kCallTimeout = std::chrono::seconds(20);

// One unary call with a deadline.
template <typename Reply, typename Stub, typename Method, typename Request>
StatusOr<Reply> Call(Stub& stub, Method method, const Request& request) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
  Reply reply;
  const grpc::Status status = (stub.*method)(&context, request, &reply);
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
    return Unavailable("mesorigd is gone: {}", status.error_message());
  }
  if (!status.ok()) return wire::FromGrpc(status);
  return reply;
}

struct DaemonClient::State {
  std::unique_ptr<v1::Control::Stub> control;
  std::unique_ptr<v1::Frames::Stub> frames;
  std::unique_ptr<v1::Operations::Stub> operations;
  v1::HelloReply hello;
};

}  // namespace mesorig::client
