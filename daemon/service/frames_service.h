#pragma once
// The Frames service (protocol/messages/frames.proto). Subscribe is a raw method: a frame goes out
// as two slices, the pixels uncopied (wire::EncodeFrame). Each subscription has a thread, which
// waits for the ledger and for the client; neither holds anybody else up. The calls on whole
// sessions (verify, journal, remove, clean) and the previews are in session_calls.cc.

#include <atomic>

#include "daemon/service/books.h"
#include "protocol/messages/frames.grpc.pb.h"

namespace mesorig::daemon {

// Borrows the books.
class FramesService final
    : public v1::Frames::WithRawCallbackMethod_Subscribe<v1::Frames::Service> {
 public:
  FramesService(Books& books, std::function<RigTime()> now)
      : sessions_(books.sessions), consumers_(books.consumers), audit_(*books.audit), now_(std::move(now)) {}

  // Ends the subscriptions.
  void BeginShutdown() { shutting_down_ = true; }

  grpc::Status GetSession(grpc::ServerContext* context, const v1::SessionRequest* request,
                          v1::SessionReply* reply) override;
  grpc::Status ListSessions(grpc::ServerContext* context, const v1::ListSessionsRequest* request,
                            v1::ListSessionsReply* reply) override;
  grpc::Status ReleaseSweep(grpc::ServerContext* context, const v1::ReleaseSweepRequest* request,
                            v1::ReleaseSweepReply* reply) override;
  grpc::Status Verify(grpc::ServerContext* context, const v1::SessionRequest* request,
                      grpc::ServerWriter<v1::VerifyReply>* writer) override;
  grpc::Status ReadJournal(grpc::ServerContext* context, const v1::SessionRequest* request,
                           v1::JournalReply* reply) override;
  grpc::Status RemoveSession(grpc::ServerContext* context, const v1::RemoveSessionRequest* request,
                             v1::RemoveSessionReply* reply) override;
  grpc::Status CleanSessions(grpc::ServerContext* context, const v1::CleanSessionsRequest* request,
                             v1::CleanSessionsReply* reply) override;
  grpc::Status Preview(grpc::ServerContext* context, const v1::PreviewRequest* request,
                       grpc::ServerWriter<v1::PreviewFrame>* writer) override;
  grpc::ServerWriteReactor<grpc::ByteBuffer>* Subscribe(grpc::CallbackServerContext* context,
                                                        const grpc::ByteBuffer* request) override;

 private:
  SessionStore& sessions_;
  ConsumerBook& consumers_;
  const AuditLog& audit_;
  const std::function<RigTime()> now_;  // rig time
  std::atomic<bool> shutting_down_{false};
};

}  // namespace mesorig::daemon
