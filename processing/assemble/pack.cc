// Assembler: from the slots of the work file to the BTF.

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "processing/assemble/assembler.h"
#include "processing/assemble/merge_exposures.h"
#include "processing/assemble/merged_positions.h"
#include "processing/btf/btf_file.h"
#include "protocol/base/digest.h"
#include "protocol/base/program.h"

namespace mesorig::assemble {
namespace {

// Mean of the frames, in double and in the order of the plan.
void WriteMean(const std::vector<std::span<const float>>& frames, std::span<float> mean) {
  std::vector<double> sums(mean.size(), 0.0);
  for (const std::span<const float> values : frames) {
    for (size_t k = 0; k < sums.size(); ++k) sums[k] += static_cast<double>(values[k]);
  }
  const double scale = 1.0 / static_cast<double>(frames.size());
  for (size_t k = 0; k < sums.size(); ++k) mean[k] = static_cast<float>(scale * sums[k]);
}

}  // namespace

void Assembler::Merge(const std::vector<const Slot*>& slots, std::span<float> merged,
                      PackFigures& figures) const {
  const bool one_exposure = std::all_of(slots.begin(), slots.end(), [&](const Slot* slot) {
    return slot->exposure_s == slots[0]->exposure_s;
  });
  if (one_exposure) {
    std::vector<std::span<const float>> frames;
    for (const Slot* slot : slots) {
      frames.push_back(Values(slot->work));
      figures.clipped_texels += slot->clipped_texels;
    }
    return WriteMean(frames, merged);
  }
  std::vector<ExposedFrame> frames;
  for (const Slot* slot : slots) {
    frames.push_back({Values(slot->work), Saturated(slot->work),
                      &rig_.cameras[static_cast<size_t>(slot->camera)], slot->exposure_s,
                      slot->irradiance});
  }
  figures.clipped_texels += MergeExposures(frames, merged);
}

StatusOr<btf::SampledBtf> Assembler::BuildBtf(PackFigures& figures) const {
  std::vector<Slot> usable;
  std::vector<Vec3> cameras, lamps;
  {
    MutexLock lock(mutex_);
    for (size_t k = 0; k < slots_.size(); ++k) {
      if (!slots_[k].usable || slots_[k].purpose != Purpose::kData) continue;
      usable.push_back(slots_[k]);
      cameras.push_back(slots_[k].camera_in_sample);
      lamps.push_back(slots_[k].lamp_in_sample);
    }
  }
  if (usable.empty()) {
    const Tally counts = tally();
    return FailedPrecondition("no usable frame: {} of {} arrived, {} refused{}{}", counts.frames,
                              frames_planned_, counts.refused, counts.refused > 0 ? ": " : "",
                              counts.first_refusal);
  }
  const Vec3 centre{0, 0, grid_.h_ref_mm};
  const MergedPositions views = MergePositions(cameras, centre);
  const MergedPositions lights = MergePositions(lamps, centre);
  btf::BtfHeader header = grid_;
  header.views = views.directions, header.view_positions_mm = views.positions_mm;
  header.lights = lights.directions, header.light_positions_mm = lights.positions_mm;
  MESORIG_RETURN_IF_ERROR(btf::CheckHeader(header));
  btf::SampledBtf btf(std::move(header));
  std::vector<std::vector<const Slot*>> slots_of(views.directions.size() * lights.directions.size());
  for (size_t k = 0; k < usable.size(); ++k) {
    slots_of[btf.PairIndex(views.index_of[k], lights.index_of[k])].push_back(&usable[k]);
  }
  figures = {btf.header().view_count(), btf.header().light_count(), 0, 0, 0, 0};
  for (int v = 0; v < figures.views; ++v) {
    for (int l = 0; l < figures.lights; ++l) {
      const std::vector<const Slot*>& slots = slots_of[btf.PairIndex(v, l)];
      if (slots.empty()) continue;
      Merge(slots, btf.MutableImage(v, l), figures);
      btf.SetPresent(v, l, true);
      ++figures.pairs;
      figures.merged_frames += static_cast<uint32_t>(slots.size() - 1);
    }
  }
  return btf;
}

std::string Assembler::Provenance(std::string_view session_id, std::string_view audit_head,
                                  const PackFigures& figures) const {
  const Tally counts = tally();
  nlohmann::json json{{"session", session_id},
                      {"plan", plan_.name},
                      {"sample", plan_.sample_name},
                      {"rig", rig_.name},
                      {"rig_sha256", rig_.sha256},
                      {"plan_sha256", Sha256(PackPlan(plan_))},
                      {"program", fmt::format("mesorig-processd {}", kVersion)},
                      {"frames", counts.frames},
                      {"frames_planned", frames_planned_},
                      {"frames_superseded", counts.superseded},
                      {"frames_refused", counts.refused},
                      {"frames_merged", figures.merged_frames},
                      {"texels_clipped", figures.clipped_texels}};
  if (!audit_head.empty()) json["audit_head"] = audit_head;
  if (counts.ambient + counts.dark + counts.flat > 0) {
    json["frames_ambient"] = counts.ambient;
    json["frames_dark"] = counts.dark;
    json["frames_flat"] = counts.flat;
  }
  return json.dump();
}

StatusOr<PackFigures> Assembler::Pack(const std::filesystem::path& path,
                                      std::string_view session_id,
                                      std::string_view audit_head) const {
  PackFigures figures;
  MESORIG_ASSIGN_OR_RETURN(btf::SampledBtf btf, BuildBtf(figures));
  btf.mutable_header().provenance_json = Provenance(session_id, audit_head, figures);
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(btf, path));
  std::error_code error;
  figures.bytes = std::filesystem::file_size(path, error);
  if (error) return Unavailable("{}: {}", path.string(), error.message());
  return figures;
}

}  // namespace mesorig::assemble
