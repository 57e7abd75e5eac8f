#pragma once
// The Control service (protocol/messages/control.proto). Stop takes no lock that Run holds. What is
// done by hand, and the lease for it, are in manual_calls.cc.

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <string>

#include "daemon/control/sequencer.h"
#include "daemon/service/books.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/control.grpc.pb.h"

namespace mesorig::daemon {

// Borrows everything.
class ControlService final : public v1::Control::Service {
 public:
  ControlService(const Rig& rig, Sequencer& sequencer, ManualControl* manual, Books& books)
      : rig_(rig),
        sequencer_(sequencer),
        manual_(manual),
        books_(books),
        sessions_(books.sessions),
        events_(books.events) {}

  // What GetStatus tells.
  v1::StatusReply DescribeStatus() const;

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
  grpc::Status AcquireLease(grpc::ServerContext* context, const v1::AcquireLeaseRequest* request,
                            v1::LeaseReply* reply) override;
  grpc::Status RenewLease(grpc::ServerContext* context, const v1::LeaseTokenRequest* request,
                          v1::LeaseReply* reply) override;
  grpc::Status ReleaseLease(grpc::ServerContext* context, const v1::LeaseTokenRequest* request,
                            v1::LeaseReply* reply) override;
  grpc::Status RequestHandover(grpc::ServerContext* context, const v1::HandoverRequest* request,
                               v1::LeaseReply* reply) override;
  grpc::Status Jog(grpc::ServerContext* context, grpc::ServerReader<v1::JogRequest>* reader,
                   v1::JogReply* reply) override;
  grpc::Status MoveAxis(grpc::ServerContext* context, const v1::MoveAxisRequest* request,
                        v1::ManualReply* reply) override;
  grpc::Status HomeAxis(grpc::ServerContext* context, const v1::HomeAxisRequest* request,
                        v1::ManualReply* reply) override;
  grpc::Status SetLamp(grpc::ServerContext* context, const v1::SetLampRequest* request,
                       v1::ManualReply* reply) override;
  grpc::Status TestLaser(grpc::ServerContext* context, const v1::TestLaserRequest* request,
                         v1::ManualReply* reply) override;
  grpc::Status ReadAudit(grpc::ServerContext* context, const v1::ReadAuditRequest* request,
                         grpc::ServerWriter<v1::AuditBytes>* writer) override;

 private:
  Status StartPlan(SequencerCommand how, const Caller& caller, const v1::RunRequest& request,
                   v1::RunReply& reply);
  Status Resume(const Caller& caller, const v1::ResumeSessionRequest& request, v1::RunReply& reply);
  // Takes the plan's lease, which ends a manual one, and waits until what is on by hand is off.
  // Without OK there is none.
  StatusOr<uint64_t> TakeRunLease(const Caller& caller, uint64_t lease_token);
  // What an audit log that takes nothing refuses, and a daemon that ends.
  Status WhyNoChange() const;
  // Gives an order by hand, and waits for its end or the client's.
  Status ByHand(const grpc::ServerContext& context, uint64_t lease_token,
                const std::function<std::future<Status>(ManualControl&)>& order);
  StatusOr<int> AxisNamed(const std::string& name) const;
  Status JogWhileHeld(const Caller& caller, grpc::ServerReader<v1::JogRequest>& reader,
                      v1::JogReply& reply);
  void TellLease(const Caller& caller, v1::LeaseReply& reply);
  // Hands the session to the sequencer; a refusal, and a Stop since `stops_before`, ends it.
  Status BeginSession(SequencerCommand how, SessionJob job, v1::RunReply& reply,
                      uint64_t stops_before);
  void Describe(const CompiledPlan& plan, const Session& session, v1::RunReply& reply) const;
  Status WhyNoRun() const;

  const Rig& rig_;
  Sequencer& sequencer_;
  ManualControl* const manual_;  // may be null
  Books& books_;
  SessionStore& sessions_;
  EventLog& events_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();

  Mutex run_mutex_;                 // one Run at a time
  std::atomic<uint64_t> stops_{0};  // a Stop during Run also stops what Run is about to start
  std::atomic<bool> shutting_down_{false};
  mutable Mutex fault_mutex_;
  std::string fault_ GUARDED_BY(fault_mutex_);
};

}  // namespace mesorig::daemon
