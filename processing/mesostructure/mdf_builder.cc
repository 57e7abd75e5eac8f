#include "processing/mesostructure/mdf_builder.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "processing/assemble/assembler.h"
#include "processing/btf/mdf_file.h"
#include "processing/mesostructure/active_sweep.h"
#include "protocol/base/check.h"
#include "protocol/base/digest.h"

namespace mesorig::mesostructure {
namespace {

using nlohmann::json;

// What a displacement file says of itself. Any JSON may stand in a file.
struct Said {
  std::string plan_sha256, empty;
  int64_t camera = -1, sweep = -1, newest_sequence = 0, frames_refused = 0;
};

Said ReadSaid(const std::string& provenance) {
  const json object = json::parse(provenance, nullptr, /*allow_exceptions=*/false);
  Said said;
  const auto text = [&](const char* key, std::string& value) {
    if (object.contains(key) && object[key].is_string()) value = object[key];
  };
  const auto number = [&](const char* key, int64_t& value) {
    if (object.contains(key) && object[key].is_number_integer()) value = object[key];
  };
  text("plan_sha256", said.plan_sha256), text("empty", said.empty);
  number("camera", said.camera), number("sweep", said.sweep);
  number("newest_sequence", said.newest_sequence), number("frames_refused", said.frames_refused);
  return said;
}

Status CheckRig(const Rig& rig, const CompiledPlan& plan) {
  if (plan.rig_sha256 != rig.sha256) {
    return InvalidArgument("plan {} was compiled for the rig {}, not for {} ({})", plan.name,
                           plan.rig_sha256, rig.name, rig.sha256);
  }
  if (!rig.laser || !rig.turntable) {
    return InvalidArgument("rig {} lacks a laser or a turntable", rig.name);
  }
  return OkStatus();
}

}  // namespace

bool MdfBuilder::HasSweeps(const CompiledPlan& plan) {
  return std::any_of(plan.steps.begin(), plan.steps.end(),
                     [](const Step& step) { return step.kind == StepKind::kSweep; });
}

StatusOr<std::unique_ptr<MdfBuilder>> MdfBuilder::Create(Rig rig, CompiledPlan plan,
                                                         std::filesystem::path folder) {
  if (!HasSweeps(plan)) return InvalidArgument("plan {} has no sweep", plan.name);
  MESORIG_RETURN_IF_ERROR(CheckRig(rig, plan));
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return InvalidArgument("cannot create {}: {}", folder.string(), error.message());
  std::unique_ptr<MdfBuilder> builder(
      new MdfBuilder(std::move(rig), std::move(plan), std::move(folder)));
  builder->TakeUp();
  return builder;
}

MdfBuilder::MdfBuilder(Rig rig, CompiledPlan plan, std::filesystem::path folder)
    : rig_(std::move(rig)),
      plan_(std::move(plan)),
      plan_sha256_(Sha256(PackPlan(plan_))),
      folder_(std::move(folder)) {
  for (const Step& step : plan_.steps) {
    if (step.kind != StepKind::kSweep) continue;
    MESORIG_CHECK(step.sweep.index == steps_.size());
    MESORIG_CHECK(step.sweep.regions.size() == step.cameras.size());
    steps_.push_back(&step);
    first_slot_.push_back(slots_.size());
    for (size_t k = 0; k < step.cameras.size(); ++k) {
      Slot slot;
      slot.step = &step, slot.camera = step.cameras[k], slot.region = step.sweep.regions[k];
      slots_.push_back(std::move(slot));
      frames_planned_ += step.sweep.frames;
    }
    open_cameras_.push_back(static_cast<uint32_t>(step.cameras.size()));
    computed_.push_back(0);
  }
  for (size_t k = 0; k < rig_.cameras.size(); ++k) {
    camera_mutexes_.push_back(std::make_unique<Mutex>());
  }
}

MdfBuilder::~MdfBuilder() = default;

std::filesystem::path MdfBuilder::PathOf(const Slot& slot) const {
  return folder_ / fmt::format("sweep{:03}_cam{}.mdf.exr", slot.step->sweep.index, slot.camera);
}

// What is not whole, or of another plan, is computed again when its frames come.
void MdfBuilder::TakeUp() {
  for (Slot& slot : slots_) {
    const auto info = btf::ReadMdfInfo(PathOf(slot));
    if (!info.ok() || info->header.view_positions_mm.size() != 1 ||
        info->header.width != plan_.product.width_px ||
        info->header.height != plan_.product.height_px) {
      continue;
    }
    const Said said = ReadSaid(info->header.provenance_json);
    const Sweep& sweep = slot.step->sweep;
    if (said.plan_sha256 != plan_sha256_ || said.camera != slot.camera ||
        said.sweep != static_cast<int64_t>(sweep.index) || said.newest_sequence <= 0) {
      continue;
    }
    slot.durable_sequence = static_cast<uint64_t>(said.newest_sequence);
    slot.camera_position = info->header.view_positions_mm[0];
    slot.empty = !said.empty.empty();
    NoteDurable(slot, said.empty);
    MutexLock lock(mutex_);
    tally_.frames += sweep.frames;
    tally_.refused += static_cast<uint32_t>(
        std::clamp<int64_t>(said.frames_refused, 0, static_cast<int64_t>(sweep.frames)));
  }
}

void MdfBuilder::NoteDurable(const Slot& slot, const std::string& why_empty) {
  const uint32_t sweep = slot.step->sweep.index;
  MutexLock lock(mutex_);
  ++tally_.images;
  if (slot.empty) {
    if (tally_.images_empty++ == 0) tally_.first_empty = why_empty;
  } else {
    computed_[sweep] = 1;
  }
  if (--open_cameras_[sweep] == 0 && computed_[sweep] != 0) releasable_.push_back(sweep);
}

StatusOr<size_t> MdfBuilder::SlotFor(const SweepFrame& frame) const {
  if (frame.camera < 0 || frame.camera >= static_cast<int>(rig_.cameras.size())) {
    return InvalidArgument("the rig has {} cameras", rig_.cameras.size());
  }
  if (frame.sweep >= steps_.size()) {
    return InvalidArgument("sweep {}, the plan has {}", frame.sweep, steps_.size());
  }
  const Step& step = *steps_[frame.sweep];
  if (frame.index >= step.sweep.frames || frame.shot != step.shot + frame.index) {
    return InvalidArgument("frame {} of sweep {}, which has shots {} to {}", frame.index,
                           frame.sweep, step.shot, step.shot + step.sweep.frames - 1);
  }
  if (frame.mount != step.sweep.mount) {
    return InvalidArgument("mount {}, the plan says {}", frame.mount, step.sweep.mount);
  }
  if (frame.sequence == 0) return InvalidArgument("a sequence number of 0");
  MESORIG_RETURN_IF_ERROR(assemble::CheckReadings(rig_, frame.axis_rad, frame.lamp_level));
  const auto found = std::find(step.cameras.begin(), step.cameras.end(), frame.camera);
  if (found == step.cameras.end())
    return InvalidArgument("the plan does not use this camera there");
  const size_t at = first_slot_[frame.sweep] + static_cast<size_t>(found - step.cameras.begin());
  const Region &is = frame.region, &planned = slots_[at].region;
  if (!(is == planned)) {
    return InvalidArgument("region {},{} {} x {}, the plan says {},{} {} x {}", is.x, is.y,
                           is.width, is.height, planned.x, planned.y, planned.width,
                           planned.height);
  }
  return at;
}

Status MdfBuilder::Add(const SweepFrame& frame, std::string_view pixels) {
  const std::string name = fmt::format("camera {}, shot {}", frame.camera, frame.shot);
  const StatusOr<size_t> at = SlotFor(frame);
  if (!at.ok()) return Annotate(at.status(), name);
  MutexLock lock(*camera_mutexes_[static_cast<size_t>(frame.camera)]);
  Slot& slot = slots_[*at];
  if (frame.sequence <= slot.durable_sequence) return OkStatus();
  return Annotate(Take(slot, frame, pixels), name);
}

Status MdfBuilder::Take(Slot& slot, const SweepFrame& frame, std::string_view pixels) {
  if (slot.active == nullptr) {
    MESORIG_ASSIGN_OR_RETURN(slot.active,
                             ActiveSweep::Begin(rig_, plan_, *slot.step, frame, slot.region));
  }
  const uint64_t before = slot.active->sequence_of(frame.index);
  if (frame.sequence <= before) return OkStatus();
  const Status status = slot.active->Add(frame, pixels);
  if (!status.ok() && !absl::IsFailedPrecondition(status)) return status;
  {
    MutexLock lock(mutex_);
    const bool again = before != 0 || slot.durable_sequence != 0;
    ++(again ? tally_.superseded : tally_.frames);
    if (!status.ok() && tally_.refused++ == 0) {
      tally_.first_refusal = fmt::format("camera {}, sweep {}, frame {}: {}", frame.camera,
                                         frame.sweep, frame.index, Message(status));
    }
  }
  return slot.active->whole() ? Finish(slot) : OkStatus();
}

Status MdfBuilder::Finish(Slot& slot) {
  const ActiveSweep& active = *slot.active;
  StatusOr<Displacement> computed = active.Compute();
  std::string why_empty;
  btf::Mdf image;
  json said = {{"plan_sha256", plan_sha256_},
               {"rig_sha256", rig_.sha256},
               {"camera", slot.camera},
               {"sweep", slot.step->sweep.index},
               {"newest_sequence", active.newest()}};
  if (computed.ok()) {
    const DisplacementFigures& f = computed->figures;
    said.update({{"frames_with_tilt", f.frames_with_tilt},
                 {"frames_bridged", f.frames_bridged},
                 {"frames_refused", slot.step->sweep.frames - f.frames_with_tilt},
                 {"pixels", f.pixels},
                 {"peaks", f.peaks},
                 {"texels", f.texels}});
    image = std::move(computed->mdf);
    if (f.texels == 0) why_empty = fmt::format("none of {} pixels saw the sheet pass", f.pixels);
  } else {
    why_empty = std::string(Message(computed.status()));
    image = btf::Mdf(DisplacementHeader(active.geometry(), plan_.product));
    said["frames_refused"] = slot.step->sweep.frames;
  }
  if (!why_empty.empty()) said["empty"] = why_empty;
  image.mutable_header().provenance_json = said.dump();
  MESORIG_RETURN_IF_ERROR(btf::WriteMdf(image, PathOf(slot)));
  const bool first = slot.durable_sequence == 0;
  slot.durable_sequence = active.newest();
  slot.camera_position = active.geometry().camera_position();
  slot.empty = !why_empty.empty();
  slot.active.reset();
  if (first) NoteDurable(slot, fmt::format("{}: {}", PathOf(slot).filename().string(), why_empty));
  return OkStatus();
}

std::vector<uint32_t> MdfBuilder::TakeReleasable() {
  MutexLock lock(mutex_);
  return std::exchange(releasable_, {});
}

SweepTally MdfBuilder::tally() const {
  MutexLock lock(mutex_);
  return tally_;
}

}  // namespace mesorig::mesostructure
