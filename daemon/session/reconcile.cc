#include "daemon/session/reconcile.h"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <vector>

namespace mesorig::daemon {
namespace {

// What does not balance: how often, and the first of each kind.
class Findings {
 public:
  void Add(std::string_view kind, std::string_view first) {
    auto [it, is_new] = kinds_.try_emplace(std::string(kind), 0, std::string(first));
    ++it->second.first;
  }
  std::vector<Imbalance> Take() const {
    std::vector<Imbalance> all;
    for (const auto& [kind, found] : kinds_) all.push_back({kind, found.second, found.first});
    return all;
  }

 private:
  std::map<std::string, std::pair<uint32_t, std::string>> kinds_;
};

class Reconciler {
 public:
  Reconciler(const CompiledPlan& plan, const Rig& rig) : plan_(plan), rig_(rig) {
    planned_.assign(rig.cameras.size(), std::vector<bool>(plan.shots));
    live_.assign(rig.cameras.size(), std::vector<uint64_t>(plan.shots));
    last_.assign(rig.cameras.size(), 0);
    step_of_shot_.assign(plan.shots, nullptr);
    for (const Step& step : plan.steps) {
      if (step.kind != StepKind::kShot && step.kind != StepKind::kSweep) continue;
      const uint32_t shots = step.kind == StepKind::kSweep ? step.sweep.frames : 1;
      for (uint32_t shot = step.shot; shot - step.shot < shots; ++shot) {
        step_of_shot_.at(shot) = &step;
        for (const int camera : step.cameras) planned_[camera].at(shot) = true;
      }
    }
  }

  void Take(const FrameRecord& r) {
    if (r.camera < 0 || static_cast<size_t>(r.camera) >= planned_.size() || r.shot >= plan_.shots ||
        !planned_[r.camera][r.shot]) {
      findings_.Add("rows that were not planned", Name(r));
      return;
    }
    if (r.sequence != ++last_[r.camera]) {
      findings_.Add("gaps in the sequence numbers", Name(r));
      last_[r.camera] = r.sequence;
    }
    CheckPicture(r);
    uint64_t& live = live_[r.camera][r.shot];
    if (live != r.supersedes) {
      findings_.Add("frames beside or superseding a wrong one",
                    fmt::format("{} supersedes {}, there is {}", Name(r), r.supersedes, live));
    }
    live = r.sequence;
    const uint64_t trigger = (uint64_t{r.run} << 32) | r.trigger_id;
    const auto [owner, is_new] = shot_of_trigger_.try_emplace(trigger, r.shot);
    if (!is_new && owner->second != r.shot) {
      findings_.Add("triggers of two shots", fmt::format("trigger {}", r.trigger_id));
    }
    CheckCameraFrame(r);
  }

  void Verify(const FrameRecord& r, const std::function<Status(const FrameRecord&)>& verify) {
    if (r.camera < 0 || static_cast<size_t>(r.camera) >= live_.size() || r.shot >= plan_.shots ||
        live_[r.camera][r.shot] != r.sequence) {
      return;  // superseded, or found before
    }
    if (const Status status = verify(r); !status.ok()) {
      findings_.Add("frames are damaged", Message(status));
    }
  }

  std::vector<Imbalance> Result() {
    uint32_t frames = 0;
    for (size_t camera = 0; camera < planned_.size(); ++camera) {
      for (uint32_t shot = 0; shot < plan_.shots; ++shot) {
        if (!planned_[camera][shot]) continue;
        ++frames;
        if (live_[camera][shot] == 0) {
          findings_.Add("are missing",
                        fmt::format("shot {}, camera {}", shot, rig_.cameras[camera].name));
        }
      }
    }
    if (frames != plan_.frames) {
      findings_.Add("totals are wrong", fmt::format("the steps have {} frames", frames));
    }
    return findings_.Take();
  }

 private:
  // A frame that the camera gave once stands for one shot only, and its time goes forward.
  void CheckCameraFrame(const FrameRecord& r) {
    if (r.camera != camera_of_frames_ || r.run != run_of_frames_) shot_of_frame_.clear();
    camera_of_frames_ = r.camera;
    run_of_frames_ = r.run;
    const auto [owner, is_new] =
        shot_of_frame_.try_emplace({r.frame_id, r.exposure_start_ns}, r.shot);
    if (!is_new && owner->second != r.shot) {
      findings_.Add("camera frames of two shots",
                    fmt::format("{}: the camera's frame {}", Name(r), r.frame_id));
    }
    if (r.exposure_end_ns < r.exposure_start_ns) {
      findings_.Add(
          "exposures that end before they begin",
          fmt::format("{}: {} ns, {} ns", Name(r), r.exposure_start_ns, r.exposure_end_ns));
    }
  }
  // Size, depth and region; of a sweep also the place in it.
  void CheckPicture(const FrameRecord& r) {
    const mesorig::Camera& camera = rig_.cameras[r.camera];
    const Step& step = *step_of_shot_[r.shot];
    Region region{0, 0, camera.width, camera.height};
    const bool sweeps = step.kind == StepKind::kSweep;
    if (sweeps) {
      const auto at = std::find(step.cameras.begin(), step.cameras.end(), r.camera);
      if (at != step.cameras.end()) region = step.sweep.regions[at - step.cameras.begin()];
    }
    if (Region{r.region_x, r.region_y, r.width, r.height} != region || r.bits != camera.bits) {
      findings_.Add("frames of another size",
                    fmt::format("{}: {} x {}, {} bits, at ({}, {})", Name(r), r.width, r.height,
                                r.bits, r.region_x, r.region_y));
    }
    const bool in_place = r.laser && r.laser->sweep == step.sweep.index &&
                          r.laser->index == r.shot - step.shot &&
                          r.laser->mount == step.sweep.mount;
    if (sweeps ? !in_place : r.laser.has_value()) {
      const std::string place = r.laser
                                    ? fmt::format("frame {} of sweep {}, mount {}", r.laser->index,
                                                  r.laser->sweep, r.laser->mount)
                                    : "none";
      findings_.Add("frames with another laser state", fmt::format("{}: {}", Name(r), place));
    }
  }
  std::string Name(const FrameRecord& r) const {
    return fmt::format("frame {} of camera {}, shot {}", r.sequence, r.camera, r.shot);
  }

  const CompiledPlan& plan_;
  const Rig& rig_;
  std::vector<std::vector<bool>> planned_;   // camera, shot
  std::vector<const Step*> step_of_shot_;    // null: planned by none
  std::vector<std::vector<uint64_t>> live_;  // camera, shot: sequence number, 0: none
  std::vector<uint64_t> last_;               // camera
  std::unordered_map<uint64_t, uint32_t> shot_of_trigger_;  // run << 32 | trigger
  // Of the camera and run that the rows have come to: camera's id and time -> shot.
  int camera_of_frames_ = -1;
  uint32_t run_of_frames_ = 0;
  std::map<std::pair<uint64_t, int64_t>, uint32_t> shot_of_frame_;
  Findings findings_;
};

}  // namespace

StatusOr<std::vector<Imbalance>> FindImbalances(
    const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
    const std::function<Status(const FrameRecord&)>& verify) {
  Reconciler reconciler(plan, rig);
  MESORIG_RETURN_IF_ERROR(ledger.ForEach([&](const FrameRecord& row) {
    reconciler.Take(row);
    return OkStatus();
  }));
  MESORIG_RETURN_IF_ERROR(ledger.ForEach([&](const FrameRecord& row) {
    reconciler.Verify(row, verify);
    return OkStatus();
  }));
  return reconciler.Result();
}

Status Reconcile(const CompiledPlan& plan, const Rig& rig, Ledger& ledger,
                 const std::function<Status(const FrameRecord&)>& verify) {
  MESORIG_ASSIGN_OR_RETURN(const auto found, FindImbalances(plan, rig, ledger, verify));
  if (found.empty()) return OkStatus();
  std::string text;
  for (const Imbalance& imbalance : found) {
    text += fmt::format("{}{} {} (first: {})", text.empty() ? "" : "; ", imbalance.count,
                        imbalance.kind, imbalance.first);
  }
  return DataLoss("the ledger does not balance: of {} planned frames {}", plan.frames, text);
}

}  // namespace mesorig::daemon
