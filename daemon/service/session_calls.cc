// The calls of the Frames service on whole sessions, and live previews.

#include <chrono>
#include <thread>

#include "daemon/service/frames_service.h"
#include "daemon/service/preview.h"
#include "daemon/session/verify.h"
#include "protocol/wire/grpc_status.h"

namespace mesorig::daemon {
namespace {

constexpr int kWaitMs = 100;             // how late an end or a cancellation is noticed
constexpr uint32_t kProgressEvery = 64;  // frames

std::string_view NameOf(JournalKind kind) {
  switch (kind) {
    case JournalKind::kBegan:
      return "began";
    case JournalKind::kResumed:
      return "resumed";
    case JournalKind::kPaused:
      return "paused";
    case JournalKind::kContinued:
      return "continued";
    case JournalKind::kPrompt:
      return "prompt";
    case JournalKind::kRecovered:
      return "recovered";
    case JournalKind::kExposure:
      return "exposure";
    case JournalKind::kReference:
      return "reference";
    case JournalKind::kAlarm:
      return "alarm";
    case JournalKind::kNote:
      return "note";
    case JournalKind::kEnded:
      return "ended";
  }
  return "unknown";
}

void Fill(const JournalEntry& entry, v1::JournalEntry* message) {
  message->set_kind(std::string(NameOf(entry.kind)));
  message->set_rig_s(static_cast<double>(entry.rig_ns) / 1e9);
  message->set_index(entry.index);
  message->set_value(entry.value);
  message->set_text(entry.text);
}

void Fill(const SessionInfo& info, v1::SessionInfo* message) {
  message->set_session_id(info.id);
  message->set_plan_name(info.plan_name);
  message->set_sample_name(info.sample_name);
  message->set_state(std::string(daemon::NameOf(info.state)));
  message->set_reason(info.reason);
  message->set_frames_planned(info.frames_planned);
  message->set_frames_durable(info.frames_durable);
  message->set_bytes(info.bytes);
  message->set_age_s(info.age_s);
}

void Fill(const VerifyReport& report, v1::VerifyReport* message) {
  message->set_balances(report.imbalances.empty());
  for (const Imbalance& imbalance : report.imbalances) {
    v1::Imbalance* const added = message->add_imbalances();
    added->set_kind(imbalance.kind);
    added->set_count(imbalance.count);
    added->set_first(imbalance.first);
  }
  message->set_rows(report.rows);
  message->set_frames_live(report.frames_live);
  message->set_frames_released(report.frames_released);
  message->set_bytes_read(report.bytes_read);
  message->set_content_digest(report.content_digest);
  message->set_starts(report.summary.starts);
  for (const JournalEntry& entry : report.entries) Fill(entry, message->add_entries());
}

}  // namespace

grpc::Status FramesService::ListSessions(grpc::ServerContext*, const v1::ListSessionsRequest*,
                                         v1::ListSessionsReply* reply) {
  const auto sessions = sessions_.Describe();
  if (!sessions.ok()) return wire::ToGrpc(sessions.status());
  for (const SessionInfo& info : *sessions) {
    reply->add_session_ids(info.id);
    Fill(info, reply->add_sessions());
  }
  reply->set_disk_free_bytes(sessions_.FreeBytes().value_or(0));
  return grpc::Status::OK;
}

grpc::Status FramesService::Verify(grpc::ServerContext* context, const v1::SessionRequest* request,
                                   grpc::ServerWriter<v1::VerifyReply>* writer) {
  const auto info = DescribeSession(sessions_.root(), request->session_id());
  if (!info.ok()) return wire::ToGrpc(info.status());
  uint32_t planned = 0;
  const auto progress = [&](uint32_t done, uint32_t frames) {
    planned = frames;
    if (context->IsCancelled() || shutting_down_) return false;
    if (done % kProgressEvery != 0) return true;
    v1::VerifyReply reply;
    reply.set_frames_done(done);
    reply.set_frames(frames);
    return writer->Write(reply);
  };
  const auto report = VerifySession(sessions_.root(), request->session_id(), progress);
  if (!report.ok()) return wire::ToGrpc(report.status());
  v1::VerifyReply reply;
  reply.set_frames_done(report->frames_live);
  reply.set_frames(report->summary.frames_planned);
  Fill(*info, reply.mutable_report()->mutable_session());
  Fill(*report, reply.mutable_report());
  writer->Write(reply);
  return grpc::Status::OK;
}

grpc::Status FramesService::ReadJournal(grpc::ServerContext*, const v1::SessionRequest* request,
                                        v1::JournalReply* reply) {
  const auto session = sessions_.Find(request->session_id());
  if (!session.ok()) return wire::ToGrpc(session.status());
  const auto entries = (*session)->Entries();
  if (!entries.ok()) return wire::ToGrpc(entries.status());
  for (const JournalEntry& entry : *entries) Fill(entry, reply->add_entries());
  return grpc::Status::OK;
}

grpc::Status FramesService::RemoveSession(grpc::ServerContext*,
                                          const v1::RemoveSessionRequest* request,
                                          v1::RemoveSessionReply* reply) {
  const auto info = DescribeSession(sessions_.root(), request->session_id());
  if (!info.ok()) return wire::ToGrpc(info.status());
  if (info->state == SessionState::kComplete && !request->complete_too()) {
    return wire::ToGrpc(FailedPrecondition("session {} is complete: say that it may go", info->id));
  }
  const auto freed = sessions_.Remove(info->id);
  if (!freed.ok()) return wire::ToGrpc(freed.status());
  reply->set_bytes_freed(*freed);
  return grpc::Status::OK;
}

grpc::Status FramesService::CleanSessions(grpc::ServerContext*,
                                          const v1::CleanSessionsRequest* request,
                                          v1::CleanSessionsReply* reply) {
  CleanRule rule;
  if (request->has_keep()) rule.keep = request->keep();
  if (request->has_older_than_s()) rule.older_than_s = request->older_than_s();
  rule.incomplete = request->incomplete_too();
  if (!rule.keep && !rule.older_than_s) {
    return wire::ToGrpc(
        InvalidArgument("which sessions may go: neither a number nor an age is said"));
  }
  const auto sessions = sessions_.Describe();
  if (!sessions.ok()) return wire::ToGrpc(sessions.status());
  uint64_t freed = 0;
  for (const std::string& id : SessionsToRemove(*sessions, rule)) {
    const auto bytes = sessions_.Remove(id);
    if (!bytes.ok()) return wire::ToGrpc(bytes.status());
    freed += *bytes;
    reply->add_session_ids(id);
  }
  reply->set_bytes_freed(freed);
  return grpc::Status::OK;
}

grpc::Status FramesService::Preview(grpc::ServerContext* context, const v1::PreviewRequest* request,
                                    grpc::ServerWriter<v1::PreviewFrame>* writer) {
  const auto camera = static_cast<int>(request->camera());
  std::shared_ptr<Session> session;
  uint64_t count = 0;
  while (!context->IsCancelled() && !shutting_down_) {
    const std::shared_ptr<Session> current = sessions_.Current();
    if (current != session) count = 0;
    session = current;
    const auto latest = session ? session->Latest(camera, count, kWaitMs) : std::nullopt;
    if (!latest) {
      if (!session || !sessions_.IsLive(*session)) {
        std::this_thread::sleep_for(std::chrono::milliseconds(kWaitMs));
      }
      continue;
    }
    const PreviewImage image = MakePreview(latest->frame.record, *latest->frame.pixels);
    v1::PreviewFrame frame;
    frame.set_session_id(session->id());
    frame.set_shot(latest->frame.record.shot);
    frame.set_width(static_cast<uint32_t>(image.width));
    frame.set_height(static_cast<uint32_t>(image.height));
    frame.set_grey(image.grey);
    frame.set_dropped(latest->count - count - 1);
    frame.set_age_s(Seconds(now_() - RigTime(latest->frame.record.exposure_end_ns)));
    count = latest->count;
    if (!writer->Write(frame)) break;  // waits for a slow client; meanwhile frames are dropped
  }
  return shutting_down_ ? wire::ToGrpc(Unavailable("mesorigd is ending"))
                        : grpc::Status(grpc::StatusCode::CANCELLED, "the client left");
}

}  // namespace mesorig::daemon
