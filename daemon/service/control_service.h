#pragma once
// The Control service (protocol/messages/control.proto). Stop takes no lock that Run holds.

#include <atomic>
#include <string>

#include "daemon/control/sequencer.h"
#include "daemon/service/event_log.h"
#include "daemon/service/session_store.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/control.grpc.pb.h"

namespace mesorig::daemon {

// Borrows everything.
class ControlService final : public v1::Control::Service {
 public:
  ControlService(const Rig& rig, Sequencer& sequencer, SessionStore& sessions, EventLog& events)
      : rig_(rig), sequencer_(sequencer), sessions_(sessions), events_(events) {}

  void ReportFault(std::string_view reason);
  void BeginShutdown();

  grpc::Status Hello(grpc::ServerContext* context, const v1::HelloRequest* request,
                     v1::HelloReply* reply) override;
  grpc::Status Run(grpc::ServerContext* context, const v1::RunRequest* request,
                   v1::RunReply* reply) override;
  grpc::Status GetStatus(grpc::ServerContext* context, const v1::StatusRequest* request,
                         v1::StatusReply* reply) override;
  grpc::Status Watch(grpc::ServerContext* context, const v1::WatchRequest* request,
                     grpc::ServerWriter<v1::Event>* writer) override;
  grpc::Status Stop(grpc::ServerContext* context, const v1::StopRequest* request,
                    v1::StopReply* reply) override;
  grpc::Status Pause(grpc::ServerContext* context, const v1::PauseRequest* request,
                     v1::PauseReply* reply) override;
  grpc::Status Arm(grpc::ServerContext* context, const v1::RunRequest* request,
                   v1::RunReply* reply) override;
  grpc::Status Start(grpc::ServerContext* context, const v1::StartRequest* request,
                     v1::StartReply* reply) override;
  grpc::Status Continue(grpc::ServerContext* context, const v1::ContinueRequest* request,
                        v1::ContinueReply* reply) override;
  grpc::Status Abort(grpc::ServerContext* context, const v1::AbortRequest* request,
                     v1::AbortReply* reply) override;
  grpc::Status Reset(grpc::ServerContext* context, const v1::ResetRequest* request,
                     v1::ResetReply* reply) override;
  grpc::Status ResumeSession(grpc::ServerContext* context, const v1::ResumeSessionRequest* request,
                             v1::RunReply* reply) override;
  grpc::Status Acknowledge(grpc::ServerContext* context, const v1::AcknowledgeRequest* request,
                           v1::AcknowledgeReply* reply) override;

 private:
  Status StartPlan(SequencerCommand how, const v1::RunRequest& request, v1::RunReply& reply);
  Status Resume(const v1::ResumeSessionRequest& request, v1::RunReply& reply);
  // Hands the session to the sequencer; a refusal, and a Stop since `stops_before`, ends it.
  Status BeginSession(SequencerCommand how, SessionJob job, v1::RunReply& reply,
                      uint64_t stops_before);
  void Describe(const CompiledPlan& plan, const Session& session, v1::RunReply& reply) const;
  Status WhyNoRun() const;

  const Rig& rig_;
  Sequencer& sequencer_;
  SessionStore& sessions_;
  EventLog& events_;

  Mutex run_mutex_;                 // one Run at a time
  std::atomic<uint64_t> stops_{0};  // a Stop during Run also stops what Run is about to start
  std::atomic<bool> shutting_down_{false};
  mutable Mutex fault_mutex_;
  std::string fault_ GUARDED_BY(fault_mutex_);
};

}  // namespace mesorig::daemon
