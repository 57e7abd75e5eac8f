#include "daemon/service/control_service.h"

#include "daemon/service/convert.h"
#include "protocol/base/log.h"
#include "protocol/base/program.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

constexpr size_t kMaxPlanBytes = 4u << 20;
constexpr std::chrono::milliseconds kWatchSlice{100};  // how late a vanished client is noticed

}  // namespace

void ControlService::ReportFault(std::string_view reason) {
  {
    MutexLock lock(fault_mutex_);
    fault_ = reason;
  }
  v1::Event event;
  event.mutable_state()->set_state(v1::FAULT);
  event.mutable_state()->set_reason(std::string(reason));
  events_.Append(std::move(event));
}

void ControlService::BeginShutdown() { shutting_down_ = true; }

Status ControlService::WhyNoRun() const {
  if (shutting_down_) return Unavailable("mesorigd is ending");
  MutexLock lock(fault_mutex_);
  if (!fault_.empty()) return Unavailable("{}", fault_);
  return OkStatus();
}

grpc::Status ControlService::Hello(grpc::ServerContext*, const v1::HelloRequest* request,
                                   v1::HelloReply* reply) {
  if (request->protocol_major() != wire::kProtocolMajor) {
    return wire::ToGrpc(FailedPrecondition(
        "{} speaks protocol version {}, mesorigd {} speaks {}: install matching versions",
        request->client().empty() ? "the client" : request->client(), request->protocol_major(),
        kVersion, wire::kProtocolMajor));
  }
  reply->set_protocol_major(wire::kProtocolMajor);
  reply->set_server(fmt::format("mesorigd {}", kVersion));
  reply->set_rig_name(rig_.name);
  reply->set_rig_sha256(rig_.sha256);
  return grpc::Status::OK;
}

grpc::Status ControlService::Run(grpc::ServerContext*, const v1::RunRequest* request,
                                 v1::RunReply* reply) {
  return wire::ToGrpc(StartPlan(*request, *reply));
}

Status ControlService::StartPlan(const v1::RunRequest& request, v1::RunReply& reply) {
  MutexLock lock(run_mutex_);
  const uint64_t stops_before = stops_;
  MESORIG_RETURN_IF_ERROR(WhyNoRun());
  const std::string name = request.plan_name().empty() ? "plan" : request.plan_name();
  if (request.plan_toml().size() > kMaxPlanBytes) {
    return InvalidArgument("{}: {} bytes, at most {} are read", name, request.plan_toml().size(),
                           kMaxPlanBytes);
  }
  MESORIG_ASSIGN_OR_RETURN(CompiledPlan plan, CompilePlan(request.plan_toml(), name, rig_));
  // (Start says the same, but a session would be on the disk by then.)
  const SequencerStatus status = sequencer_.GetStatus();
  if (status.state != SequencerState::kIdle && status.state != SequencerState::kFault) {
    return FailedPrecondition("session {} is running: stop it or wait for its end",
                              status.session_id);
  }
  reply.set_shots(plan.shots);
  reply.set_frames(plan.frames);
  reply.set_frame_bytes(plan.frame_bytes);
  reply.set_estimated_s(plan.seconds);
  reply.set_frames_blocked(plan.frames_blocked);
  reply.set_sweeps(plan.sweeps);
  reply.set_prompts(plan.prompts);
  return StartSession(std::move(plan), reply, stops_before);
}

Status ControlService::StartSession(CompiledPlan plan, v1::RunReply& reply, uint64_t stops_before) {
  MESORIG_ASSIGN_OR_RETURN(const std::shared_ptr<Session> session, sessions_.Create(plan, rig_));
  reply.set_session_id(session->id());
  Status started = stops_ == stops_before
                       ? sequencer_.Start(std::move(plan), session)
                       : Cancelled("session {}: stopped before it began", session->id());
  if (!started.ok()) {
    const Status ended = session->Finish(false, Message(started), 0, 0, true);
    if (!ended.ok()) spdlog::error("{}", Message(ended));
    return started;
  }
  // A Stop that came between the look above and Start found nothing to stop.
  if (stops_ != stops_before) return sequencer_.Stop("stopped as it began");
  return OkStatus();
}

grpc::Status ControlService::GetStatus(grpc::ServerContext*, const v1::StatusRequest*,
                                       v1::StatusReply* reply) {
  const SequencerStatus status = sequencer_.GetStatus();
  *reply = ToMessage(status, sessions_.FramesPlanned(status.session_id));
  MutexLock lock(fault_mutex_);
  if (!fault_.empty()) {
    reply->set_state(v1::FAULT);
    reply->set_message(fault_);
  }
  return grpc::Status::OK;
}

grpc::Status ControlService::Watch(grpc::ServerContext* context, const v1::WatchRequest* request,
                                   grpc::ServerWriter<v1::Event>* writer) {
  uint64_t cursor = request->after_sequence();
  while (!context->IsCancelled()) {
    const std::vector<v1::Event> events = events_.Read(cursor, kWatchSlice);
    for (const v1::Event& event : events) {
      if (!writer->Write(event)) return grpc::Status::OK;
      cursor = event.sequence();
    }
    if (events.empty() && events_.closed()) {
      return wire::ToGrpc(Unavailable("mesorigd is ending"));
    }
  }
  return grpc::Status::CANCELLED;
}

grpc::Status ControlService::Stop(grpc::ServerContext*, const v1::StopRequest* request,
                                  v1::StopReply*) {
  ++stops_;
  const std::string reason =
      request->reason().empty() ? "stopped by a client" : "stopped: " + request->reason();
  spdlog::info("{}", reason);
  return wire::ToGrpc(sequencer_.Stop(reason));
}

grpc::Status ControlService::Acknowledge(grpc::ServerContext*,
                                         const v1::AcknowledgeRequest* request,
                                         v1::AcknowledgeReply*) {
  return wire::ToGrpc(sequencer_.Acknowledge(request->prompt_id()));
}

grpc::Status ControlService::Pause(grpc::ServerContext*, const v1::PauseRequest*, v1::PauseReply*) {
  return wire::ToGrpc(
      Unimplemented("pausing a plan is not there yet; stop it (`mesorig stop`) and run it again"));
}

grpc::Status ControlService::Resume(grpc::ServerContext*, const v1::ResumeRequest*,
                                    v1::ResumeReply*) {
  return wire::ToGrpc(
      Unimplemented("resuming a session is not there yet; run its plan again (`mesorig run`)"));
}

}  // namespace mesorig::daemon
