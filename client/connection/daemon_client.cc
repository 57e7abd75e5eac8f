#include "client/connection/daemon_client.h"

#include "client/connection/daemon_calls.h"
#include "protocol/base/program.h"
#include "protocol/wire/channel.h"

namespace mesorig::client {

StatusOr<std::unique_ptr<DaemonClient>> DaemonClient::Connect(
    const wire::Address& address) {
  MESORIG_ASSIGN_OR_RETURN(const auto channel, wire::ConnectTo(address, wire::kDaemonName));
  auto state = std::make_unique<State>();
  state->control = v1::Control::NewStub(channel);
  state->frames = v1::Frames::NewStub(channel);
  state->operations = v1::Operations::NewStub(channel);
  v1::HelloRequest request;
  request.set_protocol_major(wire::kProtocolMajor);
  request.set_client(fmt::format("mesorig {}", kVersion));
  MESORIG_ASSIGN_OR_RETURN(
      state->hello, Call<v1::HelloReply>(*state->control, &v1::Control::Stub::Hello, request));
  return std::unique_ptr<DaemonClient>(new DaemonClient(std::move(state)));
}

DaemonClient::DaemonClient(std::unique_ptr<State> state) : state_(std::move(state)) {}
DaemonClient::~DaemonClient() = default;
const v1::HelloReply& DaemonClient::hello() const { return state_->hello; }

StatusOr<v1::RunReply> DaemonClient::Run(std::string_view plan_toml, std::string_view plan_name,
                                         uint64_t lease_token) {
  v1::RunRequest request;
  request.set_plan_toml(std::string(plan_toml));
  request.set_lease_token(lease_token);
  request.set_plan_name(std::string(plan_name));
  return Call<v1::RunReply>(*state_->control, &v1::Control::Stub::Run, request);
}

StatusOr<v1::StatusReply> DaemonClient::GetStatus() {
  return Call<v1::StatusReply>(*state_->control, &v1::Control::Stub::GetStatus,
                               v1::StatusRequest());
}

Status DaemonClient::Stop(std::string_view reason) {
  v1::StopRequest request;
  request.set_reason(std::string(reason));
  return Call<v1::StopReply>(*state_->control, &v1::Control::Stub::Stop, request).status();
}

StatusOr<v1::RunReply> DaemonClient::Arm(std::string_view plan_toml, std::string_view plan_name,
                                         uint64_t lease_token) {
  v1::RunRequest request;
  request.set_plan_toml(std::string(plan_toml));
  request.set_lease_token(lease_token);
  request.set_plan_name(std::string(plan_name));
  return Call<v1::RunReply>(*state_->control, &v1::Control::Stub::Arm, request);
}

Status DaemonClient::Start() {
  return Call<v1::StartReply>(*state_->control, &v1::Control::Stub::Start, v1::StartRequest())
      .status();
}

Status DaemonClient::Pause(bool now, std::string_view reason) {
  v1::PauseRequest request;
  request.set_now(now);
  request.set_reason(std::string(reason));
  return Call<v1::PauseReply>(*state_->control, &v1::Control::Stub::Pause, request).status();
}

Status DaemonClient::Continue() {
  return Call<v1::ContinueReply>(*state_->control, &v1::Control::Stub::Continue,
                                 v1::ContinueRequest())
      .status();
}

Status DaemonClient::Abort(std::string_view reason) {
  v1::AbortRequest request;
  request.set_reason(std::string(reason));
  return Call<v1::AbortReply>(*state_->control, &v1::Control::Stub::Abort, request).status();
}

Status DaemonClient::Reset() {
  return Call<v1::ResetReply>(*state_->control, &v1::Control::Stub::Reset, v1::ResetRequest())
      .status();
}

StatusOr<v1::RunReply> DaemonClient::ResumeSession(const v1::ResumeSessionRequest& request) {
  return Call<v1::RunReply>(*state_->control, &v1::Control::Stub::ResumeSession, request);
}

Status DaemonClient::Acknowledge(uint32_t prompt_id) {
  v1::AcknowledgeRequest request;
  request.set_prompt_id(prompt_id);
  return Call<v1::AcknowledgeReply>(*state_->control, &v1::Control::Stub::Acknowledge, request)
      .status();
}

StatusOr<v1::ListSessionsReply> DaemonClient::ListSessions() {
  return Call<v1::ListSessionsReply>(*state_->frames, &v1::Frames::Stub::ListSessions,
                                     v1::ListSessionsRequest());
}

StatusOr<v1::SessionReply> DaemonClient::GetSession(std::string_view session_id) {
  v1::SessionRequest request;
  request.set_session_id(std::string(session_id));
  return Call<v1::SessionReply>(*state_->frames, &v1::Frames::Stub::GetSession, request);
}

std::vector<v1::Event> DaemonClient::LastEvents(const v1::StatusReply& status, size_t count) {
  std::vector<v1::Event> events;
  const uint64_t last = status.event_sequence();
  if (last == 0) return events;
  // (The daemon may have ended meanwhile: what came is told.)
  (void)Watch(last - std::min<uint64_t>(last, count), [&](const v1::Event& event) {
    events.push_back(event);
    return event.sequence() < last;
  });
  return events;
}

StatusOr<v1::DiagnoseReply> DaemonClient::Diagnose() {
  return Call<v1::DiagnoseReply>(*state_->operations, &v1::Operations::Stub::Diagnose,
                                 v1::DiagnoseRequest());
}

}  // namespace mesorig::client
