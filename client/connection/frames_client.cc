#include "client/connection/frames_client.h"

#include <grpcpp/grpcpp.h>

#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::client {
namespace {

constexpr auto kCallTimeout = std::chrono::minutes(5);  // many sessions may have to go

Status FromCall(const grpc::Status& status) {
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
    return Unavailable("mesorigd is gone: {}", status.error_message());
  }
  return wire::FromGrpc(status);
}

template <typename Reply, typename Method, typename Request>
StatusOr<Reply> Call(v1::Frames::Stub& stub, Method method, const Request& request) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
  Reply reply;
  MESORIG_RETURN_IF_ERROR(FromCall((stub.*method)(&context, request, &reply)));
  return reply;
}

v1::SessionRequest Naming(std::string_view session_id) {
  v1::SessionRequest request;
  request.set_session_id(std::string(session_id));
  return request;
}

}  // namespace

struct FramesClient::State {
  std::unique_ptr<v1::Frames::Stub> frames;
};

StatusOr<std::unique_ptr<FramesClient>> FramesClient::Connect(
    const wire::Address& address) {
  MESORIG_ASSIGN_OR_RETURN(const auto channel, wire::ConnectTo(address, wire::kDaemonName));
  auto state = std::make_unique<State>();
  state->frames = v1::Frames::NewStub(channel);
  return std::unique_ptr<FramesClient>(new FramesClient(std::move(state)));
}

FramesClient::FramesClient(std::unique_ptr<State> state) : state_(std::move(state)) {}
FramesClient::~FramesClient() = default;

StatusOr<v1::ListSessionsReply> FramesClient::ListSessions() {
  return Call<v1::ListSessionsReply>(*state_->frames, &v1::Frames::Stub::ListSessions,
                                     v1::ListSessionsRequest());
}

StatusOr<v1::SessionReply> FramesClient::GetSession(std::string_view session_id) {
  return Call<v1::SessionReply>(*state_->frames, &v1::Frames::Stub::GetSession, Naming(session_id));
}

StatusOr<v1::JournalReply> FramesClient::ReadJournal(std::string_view session_id) {
  return Call<v1::JournalReply>(*state_->frames, &v1::Frames::Stub::ReadJournal,
                                Naming(session_id));
}

StatusOr<v1::RemoveSessionReply> FramesClient::Remove(std::string_view session_id,
                                                      bool complete_too) {
  v1::RemoveSessionRequest request;
  request.set_session_id(std::string(session_id));
  request.set_complete_too(complete_too);
  return Call<v1::RemoveSessionReply>(*state_->frames, &v1::Frames::Stub::RemoveSession, request);
}

StatusOr<v1::CleanSessionsReply> FramesClient::Clean(std::optional<uint32_t> keep,
                                                     std::optional<double> older_than_s,
                                                     bool incomplete_too) {
  v1::CleanSessionsRequest request;
  if (keep) request.set_keep(*keep);
  if (older_than_s) request.set_older_than_s(*older_than_s);
  request.set_incomplete_too(incomplete_too);
  return Call<v1::CleanSessionsReply>(*state_->frames, &v1::Frames::Stub::CleanSessions, request);
}

StatusOr<v1::VerifyReport> FramesClient::Verify(
    std::string_view session_id, const std::function<void(uint32_t, uint32_t)>& progress) {
  grpc::ClientContext context;
  const auto stream = state_->frames->Verify(&context, Naming(session_id));
  v1::VerifyReply reply;
  std::optional<v1::VerifyReport> report;
  while (stream->Read(&reply)) {
    progress(reply.frames_done(), reply.frames());
    if (reply.has_report()) report = reply.report();
  }
  MESORIG_RETURN_IF_ERROR(FromCall(stream->Finish()));
  if (!report) return Internal("mesorigd ended the verification without a report");
  return *std::move(report);
}

Status FramesClient::ReadFrames(std::string_view session_id, uint32_t camera,
                                const std::function<Status(const v1::Frame&)>& on_frame) {
  grpc::ClientContext context;
  v1::SubscribeRequest request;
  request.set_session_id(std::string(session_id));
  request.set_camera(camera);
  const auto stream = state_->frames->Subscribe(&context, request);
  v1::Frame frame;
  while (stream->Read(&frame)) {
    const Status status = on_frame(frame);
    if (status.ok()) continue;
    context.TryCancel();
    stream->Finish();
    return status;
  }
  const grpc::Status status = stream->Finish();
  return status.error_code() == grpc::StatusCode::ABORTED ? OkStatus() : FromCall(status);
}

StatusOr<v1::PreviewFrame> FramesClient::NextPreview(uint32_t camera) {
  grpc::ClientContext context;
  v1::PreviewRequest request;
  request.set_camera(camera);
  const auto stream = state_->frames->Preview(&context, request);
  v1::PreviewFrame frame;
  const bool got = stream->Read(&frame);
  context.TryCancel();
  const grpc::Status status = stream->Finish();
  if (got) return frame;
  return FromCall(status);
}

}  // namespace mesorig::client
