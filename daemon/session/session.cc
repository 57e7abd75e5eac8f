#include "daemon/session/session.h"

#include "daemon/session/stored_session.h"
#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"

namespace mesorig::daemon {
namespace {

Status CheckSha(const std::filesystem::path& file, std::string_view bytes,
                std::string_view recorded) {
  if (const std::string sha = Sha256(bytes); sha != recorded) {
    return DataLoss("{}: SHA-256 is {}, the journal recorded {}", file.string(), sha, recorded);
  }
  return OkStatus();
}

// As it lies there, its files checked against the journal.
StatusOr<std::shared_ptr<StoredSession>> Load(const std::filesystem::path& root,
                                              const std::string& id, DiskFaults* faults) {
  std::error_code error;
  SessionFolder folder(root / id);
  if (!IsFileName(id) || !std::filesystem::exists(folder.journal(), error)) {
    return NotFound("no session \"{}\" in {}", id, root.string());
  }
  MESORIG_ASSIGN_OR_RETURN(const auto ledger, Ledger::Open(folder.journal(), faults));
  MESORIG_ASSIGN_OR_RETURN(SessionSummary summary, ledger->ReadSummary());
  MESORIG_ASSIGN_OR_RETURN(std::string plan_bin, ReadFile(folder.plan(), size_t{1} << 30));
  MESORIG_RETURN_IF_ERROR(CheckSha(folder.plan(), plan_bin, summary.plan_sha256));
  MESORIG_ASSIGN_OR_RETURN(const std::string rig_toml, ReadFile(folder.rig()));
  MESORIG_RETURN_IF_ERROR(CheckSha(folder.rig(), rig_toml, summary.rig_sha256));
  MESORIG_ASSIGN_OR_RETURN(Rig rig, ParseRig(rig_toml, folder.rig().string()));
  auto session = std::make_shared<StoredSession>(std::move(folder), std::move(rig),
                                                 std::move(plan_bin), std::move(summary));
  MESORIG_RETURN_IF_ERROR(session->OpenForReading(faults));
  return session;
}

}  // namespace

StatusOr<std::shared_ptr<Session>> Session::Create(const std::filesystem::path& root,
                                                   const CompiledPlan& plan, const Rig& rig,
                                                   SessionOptions options) {
  MESORIG_RETURN_IF_ERROR(CheckPlan(plan, rig));
  std::string plan_bin = PackPlan(plan);
  SessionSummary summary;
  summary.plan_name = plan.name;
  summary.plan_sha256 = Sha256(plan_bin);
  summary.rig_sha256 = rig.sha256;
  summary.sample_name = plan.sample_name;
  summary.sample_sha256 = plan.sample_sha256;
  summary.frames_planned = plan.frames;
  MESORIG_ASSIGN_OR_RETURN(SessionFolder folder,
                           CreateSessionFolder(root, rig, plan_bin, summary, options.faults));
  auto session = std::make_shared<StoredSession>(std::move(folder), rig, std::move(plan_bin),
                                                 std::move(summary));
  MESORIG_RETURN_IF_ERROR(session->OpenForReading(options.faults));
  MESORIG_RETURN_IF_ERROR(session->BeginWriting(plan, options, false));
  return session;
}

StatusOr<std::shared_ptr<Session>> Session::Open(const std::filesystem::path& root,
                                                 const std::string& id) {
  MESORIG_ASSIGN_OR_RETURN(auto session, Load(root, id, nullptr));
  session->RemoveReleased();
  return session;
}

StatusOr<std::shared_ptr<Session>> Session::Resume(const std::filesystem::path& root,
                                                   const std::string& id, const Rig& rig,
                                                   SessionOptions options) {
  MESORIG_ASSIGN_OR_RETURN(auto session, Load(root, id, options.faults));
  const SessionSummary summary = session->Summary();
  if (summary.rig_sha256 != rig.sha256) {
    return InvalidArgument("session {}: its rig has the SHA-256 {}, this one {}", id,
                           summary.rig_sha256, rig.sha256);
  }
  if (summary.end == SessionEnd::kComplete && options.again.empty()) {
    return FailedPrecondition("session {} is complete: nothing is missing", id);
  }
  MESORIG_ASSIGN_OR_RETURN(const CompiledPlan plan, UnpackPlan(session->plan_bin(), rig));
  MESORIG_RETURN_IF_ERROR(CheckPlan(plan, rig));
  MESORIG_RETURN_IF_ERROR(session->CheckAgain(plan, options.again));
  MESORIG_RETURN_IF_ERROR(session->BeginWriting(plan, options, true));
  if (summary.end == SessionEnd::kComplete) session->StaysComplete();
  session->Forget(options.again);
  if (options.faults == nullptr) session->RemoveReleased();
  return session;
}

}  // namespace mesorig::daemon
