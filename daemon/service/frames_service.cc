#include "daemon/service/frames_service.h"

#include <grpcpp/impl/codegen/proto_utils.h>
#include <pthread.h>

#include <thread>

#include "daemon/service/convert.h"
#include "protocol/base/mutex.h"
#include "protocol/wire/frame_codec.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

constexpr int kWaitMs = 100;  // how late an end or a cancellation is noticed

// One stream. Deletes itself in OnDone.
class Subscription final : public grpc::ServerWriteReactor<grpc::ByteBuffer> {
 public:
  Subscription(SessionStore& sessions, ConsumerBook& consumers, std::string peer,
               const std::atomic<bool>& shutting_down, const grpc::ByteBuffer& request)
      : sessions_(sessions),
        figures_(consumers, std::move(peer)),
        shutting_down_(shutting_down),
        request_(request) {
    thread_ = std::thread([this] {
      ::pthread_setname_np(::pthread_self(), "subscription");
      Finish(wire::ToGrpc(Run()));
    });
  }

  void OnWriteDone(bool ok) override {
    MutexLock lock(mutex_);
    writing_ = false;
    broken_ = broken_ || !ok;
    changed_.NotifyAll();
  }
  void OnCancel() override {
    MutexLock lock(mutex_);
    broken_ = true;
    changed_.NotifyAll();
  }
  void OnDone() override {
    thread_.join();
    delete this;
  }

 private:
  Status Run();
  // On what is there, then as frames come, to the end of the session; sets it to the one that was
  // sent last (a resume opens it anew).
  Status SendAll(std::shared_ptr<Session>& session, int camera, uint64_t cursor);
  // False when the client is gone.
  bool Write(const StoredFrame& frame) EXCLUDES(mutex_);
  bool broken() EXCLUDES(mutex_) {
    MutexLock lock(mutex_);
    return broken_;
  }

  SessionStore& sessions_;
  ConsumerBook::Stream figures_;
  const std::atomic<bool>& shutting_down_;
  grpc::ByteBuffer request_;
  grpc::ByteBuffer buffer_;  // what is being written
  Mutex mutex_;
  CondVar changed_;
  bool writing_ GUARDED_BY(mutex_) = false;
  bool broken_ GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

Status Subscription::Run() {
  v1::SubscribeRequest request;
  const grpc::Status parsed =
      grpc::SerializationTraits<v1::SubscribeRequest>::Deserialize(&request_, &request);
  if (!parsed.ok()) return InvalidArgument("not a SubscribeRequest");
  MESORIG_ASSIGN_OR_RETURN(auto session, sessions_.Find(request.session_id()));
  return SendAll(session, static_cast<int>(request.camera()), request.cursor());
}

Status Subscription::SendAll(std::shared_ptr<Session>& session, int camera, uint64_t cursor) {
  for (;;) {
    if (broken()) return Cancelled("the subscriber left");
    if (shutting_down_) return Unavailable("mesorigd is ending");
    // Looked at before the ledger: once ended, an empty answer means that there is no more.
    const bool live = sessions_.IsLive(*session);
    MESORIG_ASSIGN_OR_RETURN(const std::optional<StoredFrame> frame,
                             session->Next(camera, cursor, live ? kWaitMs : 0));
    if (frame) {
      cursor = frame->record.sequence;
      if (!Write(*frame)) return Cancelled("the subscriber left");
      figures_.CountFrame();
    } else if (!live) {
      // It may have been resumed since: then its further frames are another object's.
      const auto now = sessions_.Find(session->id());
      if (!now.ok() || *now == session) break;
      session = *now;
    }
  }
  const SessionSummary summary = session->Summary();
  if (summary.end == SessionEnd::kComplete) return OkStatus();
  return absl::AbortedError(fmt::format(
      "session {} is incomplete: {}", session->id(),
      summary.end == SessionEnd::kOpen ? "the daemon that wrote it died" : summary.reason));
}

bool Subscription::Write(const StoredFrame& frame) {
  buffer_ = wire::EncodeFrame(ToMessage(frame.record), *frame.pixels, frame.pixels);
  {
    MutexLock lock(mutex_);
    if (broken_) return false;
    writing_ = true;
  }
  StartWrite(&buffer_);
  MutexLock lock(mutex_);
  while (writing_) changed_.Wait(mutex_);  // (also ends when the call is cancelled)
  return !broken_;
}

}  // namespace

grpc::Status FramesService::GetSession(grpc::ServerContext*, const v1::SessionRequest* request,
                                       v1::SessionReply* reply) {
  const auto session = sessions_.Find(request->session_id());
  if (!session.ok()) return wire::ToGrpc(session.status());
  const SessionSummary summary = (*session)->Summary();
  reply->set_session_id(summary.id);
  reply->set_rig_toml((*session)->rig_toml());
  reply->set_plan_bin((*session)->plan_bin());
  reply->set_plan_sha256(summary.plan_sha256);
  // One that was killed gets no further frames: ended, and not complete.
  reply->set_ended(!sessions_.IsLive(**session));
  reply->set_complete(summary.end == SessionEnd::kComplete);
  reply->set_deterministic(summary.deterministic);
  reply->set_starts(summary.starts);
  reply->set_audit_head(AnchorText(audit_.head()));
  return grpc::Status::OK;
}

grpc::Status FramesService::ReleaseSweep(grpc::ServerContext*,
                                         const v1::ReleaseSweepRequest* request,
                                         v1::ReleaseSweepReply* reply) {
  const auto session = sessions_.Find(request->session_id());
  if (!session.ok()) return wire::ToGrpc(session.status());
  const auto freed = (*session)->ReleaseSweep(request->sweep());
  if (!freed.ok()) return wire::ToGrpc(freed.status());
  reply->set_bytes_freed(*freed);
  return grpc::Status::OK;
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* FramesService::Subscribe(
    grpc::CallbackServerContext* context, const grpc::ByteBuffer* request) {
  return new Subscription(sessions_, consumers_, context->peer(), shutting_down_, *request);  // owned by itself
}

}  // namespace mesorig::daemon
