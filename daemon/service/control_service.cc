#include "daemon/service/control_service.h"

#include <algorithm>

#include "daemon/service/convert.h"
#include "protocol/base/log.h"
#include "protocol/base/program.h"
#include "protocol/plan/shot_selection.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

constexpr size_t kMaxPlanBytes = 4u << 20;
constexpr std::chrono::milliseconds kWatchSlice{100};  // how late a vanished client is noticed
constexpr double kRest_s = 10;  // host time: what is on by hand goes off before a plan begins

struct Missing {
  uint32_t frames = 0;
  uint64_t bytes = 0;
};

Missing CountMissing(const CompiledPlan& plan, const Rig& rig, const Session& session) {
  Missing missing;
  for (const Step& step : plan.steps) {
    const bool sweep = step.kind == StepKind::kSweep;
    if (!sweep && step.kind != StepKind::kShot) continue;
    for (uint32_t i = 0; i < (sweep ? step.sweep.frames : 1); ++i) {
      for (const int camera : session.Missing(step.shot + i)) {
        const auto at = std::find(step.cameras.begin(), step.cameras.end(), camera);
        if (at == step.cameras.end()) continue;
        const mesorig::Camera& description = rig.cameras[camera];
        const Region region =
            sweep ? step.sweep.regions[at - step.cameras.begin()] : description.full_region();
        ++missing.frames;
        missing.bytes += uint64_t{1} * region.width * region.height * description.bytes_per_pixel();
      }
    }
  }
  return missing;
}

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

Status ControlService::WhyNoChange() const {
  if (shutting_down_) return Unavailable("mesorigd is ending");
  return Annotate(books_.audit->health(), "nothing is changed that cannot be recorded: audit log");
}

Status ControlService::WhyNoRun() const {
  MESORIG_RETURN_IF_ERROR(WhyNoChange());
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
  reply->set_life(events_.life());
  return grpc::Status::OK;
}

grpc::Status ControlService::Run(grpc::ServerContext* context, const v1::RunRequest* request,
                                 v1::RunReply* reply) {
  return wire::ToGrpc(StartPlan(SequencerCommand::kRun, CallerOf(*context), *request, *reply));
}

grpc::Status ControlService::Arm(grpc::ServerContext* context, const v1::RunRequest* request,
                                 v1::RunReply* reply) {
  return wire::ToGrpc(StartPlan(SequencerCommand::kArm, CallerOf(*context), *request, *reply));
}

grpc::Status ControlService::ResumeSession(grpc::ServerContext* context,
                                           const v1::ResumeSessionRequest* request,
                                           v1::RunReply* reply) {
  return wire::ToGrpc(Resume(CallerOf(*context), *request, *reply));
}

StatusOr<uint64_t> ControlService::TakeRunLease(const Caller& caller, uint64_t lease_token) {
  MESORIG_ASSIGN_OR_RETURN(const uint64_t token, books_.lease->BeginRun(caller, lease_token));
  books_.run_token = token;
  const Status rest = manual_ == nullptr ? OkStatus() : manual_->AwaitRest(kRest_s);
  if (rest.ok()) return token;
  books_.lease->EndRun(token);
  return rest;
}

Status ControlService::StartPlan(SequencerCommand how, const Caller& caller,
                                 const v1::RunRequest& request, v1::RunReply& reply) {
  MutexLock lock(run_mutex_);
  const uint64_t stops_before = stops_;
  MESORIG_RETURN_IF_ERROR(WhyNoRun());
  const std::string name = request.plan_name().empty() ? "plan" : request.plan_name();
  if (request.plan_toml().size() > kMaxPlanBytes) {
    return InvalidArgument("{}: {} bytes, at most {} are read", name, request.plan_toml().size(),
                           kMaxPlanBytes);
  }
  SessionJob job;
  MESORIG_ASSIGN_OR_RETURN(job.plan, CompilePlan(request.plan_toml(), name, rig_));
  // Before there is a session on the disk.
  MESORIG_RETURN_IF_ERROR(sequencer_.CheckBegin(how, job.plan));
  MESORIG_ASSIGN_OR_RETURN(const uint64_t lease, TakeRunLease(caller, request.lease_token()));
  auto created = sessions_.Create(job.plan, rig_);
  Status begun = created.status();
  if (begun.ok()) {
    const std::shared_ptr<Session> session = job.session = *created;
    begun = BeginSession(how, std::move(job), reply, stops_before);
    if (!begun.ok()) sessions_.Discard(session, Message(begun));
  }
  if (!begun.ok()) books_.lease->EndRun(lease);
  return begun;
}

Status ControlService::Resume(const Caller& caller, const v1::ResumeSessionRequest& request,
                              v1::RunReply& reply) {
  MutexLock lock(run_mutex_);
  const uint64_t stops_before = stops_;
  MESORIG_RETURN_IF_ERROR(WhyNoRun());
  SessionJob job;
  job.resumed = true;
  job.accept_reference = request.accept_reference();
  {
    // Looked at before it is opened for writing, so that a refusal leaves it as it was.
    MESORIG_ASSIGN_OR_RETURN(const auto session, sessions_.Find(request.session_id()));
    MESORIG_ASSIGN_OR_RETURN(job.plan, UnpackPlan(session->plan_bin(), rig_));
  }
  ShotSelection again;
  if (!request.reshoot().empty()) {
    MESORIG_ASSIGN_OR_RETURN(again, ParseShotSelection(request.reshoot(), job.plan, rig_));
  }
  if (job.plan.sample_name != request.sample_name()) {
    return FailedPrecondition("session {} is of sample \"{}\", not of \"{}\"", request.session_id(),
                              job.plan.sample_name, request.sample_name());
  }
  MESORIG_RETURN_IF_ERROR(sequencer_.CheckBegin(SequencerCommand::kResume, job.plan));
  MESORIG_ASSIGN_OR_RETURN(const uint64_t lease, TakeRunLease(caller, request.lease_token()));
  auto resumed = sessions_.Resume(request.session_id(), rig_, std::move(again));
  if (!resumed.ok()) {
    books_.lease->EndRun(lease);
    return resumed.status();
  }
  const std::shared_ptr<Session> session = job.session = *resumed;
  const Status begun = BeginSession(SequencerCommand::kResume, std::move(job), reply, stops_before);
  if (!begun.ok()) {
    books_.lease->EndRun(lease);
    const Status ended = session->Finish(false, Message(begun), 0, 0, true);
    if (!ended.ok()) Log("service").error("session {}: {}", session->id(), Message(ended));
  }
  return begun;
}

Status ControlService::BeginSession(SequencerCommand how, SessionJob job, v1::RunReply& reply,
                                    uint64_t stops_before) {
  Describe(job.plan, *job.session, reply);
  reply.set_event_sequence(events_.last());
  reply.set_life(events_.life());
  // Whoever verifies the audit log finds in the journal how far it was.
  const Status noted = job.session->Record({JournalKind::kNote, sequencer_.GetStatus().now.count(),
                                            -1, 0, AnchorText(books_.audit->head())});
  if (!noted.ok()) Log("service").error("session {}: {}", job.session->id(), Message(noted));
  if (stops_ != stops_before) {
    return Cancelled("session {}: stopped before it began", job.session->id());
  }
  MESORIG_RETURN_IF_ERROR(sequencer_.Begin(how, std::move(job)));
  if (!reply.warning().empty()) {
    v1::Event event;
    event.set_note(reply.warning());
    events_.Append(std::move(event));
  }
  // A Stop that came between the look above and Begin found nothing to stop.
  return stops_ == stops_before ? OkStatus() : sequencer_.Stop("stopped as it began");
}

void ControlService::Describe(const CompiledPlan& plan, const Session& session,
                              v1::RunReply& reply) const {
  reply.set_session_id(session.id());
  reply.set_shots(plan.shots);
  reply.set_frames(plan.frames);
  reply.set_frame_bytes(plan.frame_bytes);
  reply.set_estimated_s(plan.seconds);
  reply.set_frames_blocked(plan.frames_blocked);
  reply.set_sweeps(plan.sweeps);
  reply.set_prompts(plan.prompts);
  const Missing missing = CountMissing(plan, rig_, session);
  reply.set_frames_missing(missing.frames);
  reply.set_missing_bytes(missing.bytes);
  const auto free = sessions_.FreeBytes();
  if (!free) return;
  reply.set_disk_free_bytes(*free);
  if (*free >= missing.bytes) return;
  reply.set_warning(fmt::format(
      "the disk has {:.1f} MB free and {:.1f} MB are to come: the run will pause when it is full",
      static_cast<double>(*free) / 1e6, static_cast<double>(missing.bytes) / 1e6));
}

v1::StatusReply ControlService::DescribeStatus() const {
  const SequencerStatus status = sequencer_.GetStatus();
  v1::StatusReply reply = ToMessage(status, sessions_.FramesPlanned(status.session_id));
  reply.set_disk_free_bytes(sessions_.FreeBytes().value_or(0));
  *reply.mutable_lease() = ToMessage(books_.lease->State());
  if (manual_ != nullptr) {
    const ManualStatus manual = manual_->GetStatus();
    reply.set_manual(manual.doing);
    for (const Reading& reading : manual.readings) {
      *reply.add_readings() = ToMessage(reading, status.now);
    }
  }
  const ChainHead head = books_.audit->head();
  reply.set_audit_sequence(head.sequence);
  reply.set_audit_head(head.hash);
  reply.set_audit_trouble(std::string(Message(books_.audit->health())));
  reply.set_event_sequence(events_.last());
  reply.set_uptime_s(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count());
  for (const ConsumerFigures& figures : books_.consumers.Get()) {
    v1::Consumer& consumer = *reply.add_consumers();
    consumer.set_peer(figures.peer);
    consumer.set_streams(figures.streams);
    consumer.set_frames_sent(figures.frames_sent);
  }
  MutexLock lock(fault_mutex_);
  if (!fault_.empty()) {
    reply.set_state(v1::FAULT);
    reply.set_message(fault_);
  }
  return reply;
}

grpc::Status ControlService::GetStatus(grpc::ServerContext*, const v1::StatusRequest*,
                                       v1::StatusReply* reply) {
  *reply = DescribeStatus();
  return grpc::Status::OK;
}

grpc::Status ControlService::Watch(grpc::ServerContext* context, const v1::WatchRequest* request,
                                   grpc::ServerWriter<v1::Event>* writer) {
  uint64_t cursor = request->after_sequence();
  std::string life = request->life();
  while (!context->IsCancelled()) {
    const std::vector<v1::Event> events = events_.Read(cursor, life, kWatchSlice);
    life = events_.life();
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
  if (manual_ != nullptr) manual_->Stop(reason);
  Log("service").info("{}", reason);
  return wire::ToGrpc(sequencer_.Stop(reason));
}

grpc::Status ControlService::Acknowledge(grpc::ServerContext*,
                                         const v1::AcknowledgeRequest* request,
                                         v1::AcknowledgeReply*) {
  return wire::ToGrpc(sequencer_.Acknowledge(request->prompt_id()));
}

grpc::Status ControlService::Start(grpc::ServerContext*, const v1::StartRequest*, v1::StartReply*) {
  return wire::ToGrpc(sequencer_.Command(SequencerCommand::kStart, ""));
}

grpc::Status ControlService::Pause(grpc::ServerContext*, const v1::PauseRequest* request,
                                   v1::PauseReply*) {
  const std::string reason =
      request->reason().empty() ? "paused by a client" : "paused: " + request->reason();
  return wire::ToGrpc(sequencer_.Command(
      request->now() ? SequencerCommand::kPauseNow : SequencerCommand::kPause, reason));
}

grpc::Status ControlService::Continue(grpc::ServerContext*, const v1::ContinueRequest*,
                                      v1::ContinueReply*) {
  return wire::ToGrpc(sequencer_.Command(SequencerCommand::kContinue, ""));
}

grpc::Status ControlService::Abort(grpc::ServerContext*, const v1::AbortRequest* request,
                                   v1::AbortReply*) {
  const std::string reason =
      request->reason().empty() ? "aborted by a client" : "aborted: " + request->reason();
  Log("service").info("{}", reason);
  return wire::ToGrpc(sequencer_.Command(SequencerCommand::kAbort, reason));
}

grpc::Status ControlService::Reset(grpc::ServerContext* context, const v1::ResetRequest* request,
                                   v1::ResetReply*) {
  const Status free = books_.lease->CheckFree(CallerOf(*context), request->lease_token());
  if (!free.ok()) return wire::ToGrpc(free);
  return wire::ToGrpc(sequencer_.Command(SequencerCommand::kReset, ""));
}

}  // namespace mesorig::daemon
