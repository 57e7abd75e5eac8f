#include "client/connection/processing_client.h"

#include <grpcpp/grpcpp.h>

#include "protocol/messages/processing.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::client {

struct ProcessingClient::State {
  std::unique_ptr<v1::Processing::Stub> stub;
};

StatusOr<std::unique_ptr<ProcessingClient>> ProcessingClient::Connect(
    const std::filesystem::path& runtime_dir) {
  MESORIG_ASSIGN_OR_RETURN(const auto channel, wire::ConnectTo(runtime_dir, wire::kProcessingName));
  auto state = std::make_unique<State>();
  state->stub = v1::Processing::NewStub(channel);
  return std::unique_ptr<ProcessingClient>(new ProcessingClient(std::move(state)));
}

ProcessingClient::ProcessingClient(std::unique_ptr<State> state) : state_(std::move(state)) {}
ProcessingClient::~ProcessingClient() = default;

StatusOr<v1::ProductsReply> ProcessingClient::GetProducts(std::string_view session_id) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  v1::ProductsRequest request;
  request.set_session_id(std::string(session_id));
  v1::ProductsReply reply;
  MESORIG_RETURN_IF_ERROR(wire::FromGrpc(state_->stub->GetProducts(&context, request, &reply)));
  return reply;
}

StatusOr<v1::ProductsReply> ProcessingClient::AwaitProducts(std::string_view session_id) {
  grpc::ClientContext context;  // as long as it takes
  v1::ProductsRequest request;
  request.set_session_id(std::string(session_id));
  v1::ProductsReply reply;
  const grpc::Status status = state_->stub->AwaitProducts(&context, request, &reply);
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
    return Unavailable("mesorig-processd is gone: {}", status.error_message());
  }
  MESORIG_RETURN_IF_ERROR(wire::FromGrpc(status));
  return reply;
}

}  // namespace mesorig::client
