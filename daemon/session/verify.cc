#include "daemon/session/verify.h"

#include "daemon/session/planned_sweeps.h"
#include "daemon/session/segment_files.h"
#include "daemon/session/session_folder.h"
#include "protocol/base/digest.h"

namespace mesorig::daemon {

StatusOr<std::string> ContentDigest(Ledger& ledger) {
  // (A chain: nothing has to be kept of what went before.)
  std::string digest = FrameDigest("mesorig session");
  MESORIG_RETURN_IF_ERROR(ledger.ForEachLive([&](const FrameRecord& row) {
    digest = FrameDigest(fmt::format("{} {} {} {}", digest, row.camera, row.shot, row.digest));
    return OkStatus();
  }));
  return digest;
}

StatusOr<VerifyReport> VerifySession(const std::filesystem::path& root, const std::string& id,
                                     const std::function<bool(uint32_t, uint32_t)>& progress) {
  MESORIG_ASSIGN_OR_RETURN(const auto session, Session::Open(root, id));
  VerifyReport report;
  report.summary = session->Summary();
  const SessionFolder folder(root / id);
  MESORIG_ASSIGN_OR_RETURN(const Rig rig, ParseRig(session->rig_toml(), folder.rig().string()));
  MESORIG_ASSIGN_OR_RETURN(const CompiledPlan plan, UnpackPlan(session->plan_bin(), rig));
  MESORIG_RETURN_IF_ERROR(CheckPlan(plan, rig));
  std::vector<std::string> names;
  for (const mesorig::Camera& camera : rig.cameras) names.push_back(camera.name);
  SegmentReaders segments(folder, id, names);
  MESORIG_ASSIGN_OR_RETURN(const auto ledger, Ledger::Open(folder.journal()));
  bool goes_on = true;
  const auto verify = [&](const FrameRecord& row) -> Status {
    if (!goes_on) return OkStatus();
    goes_on = progress == nullptr || progress(report.frames_live, plan.frames);
    ++report.frames_live;
    MESORIG_ASSIGN_OR_RETURN(const auto pixels, segments.Read(row));
    if (pixels == nullptr) {
      ++report.frames_released;
    } else {
      report.bytes_read += pixels->size();
    }
    return OkStatus();
  };
  MESORIG_ASSIGN_OR_RETURN(report.imbalances, FindImbalances(plan, rig, *ledger, verify));
  if (!goes_on) return Cancelled("verifying session {} was called off", id);
  MESORIG_ASSIGN_OR_RETURN(report.content_digest, ContentDigest(*ledger));
  MESORIG_ASSIGN_OR_RETURN(report.entries, ledger->ReadEntries());
  report.rows = report.summary.frames_durable;
  return report;
}

}  // namespace mesorig::daemon
