// MdfBuilder: from the displacement images to the MDF.

#include <algorithm>
#include <nlohmann/json.hpp>

#include "processing/assemble/merged_positions.h"
#include "processing/btf/mdf_file.h"
#include "processing/mesostructure/active_sweep.h"
#include "processing/mesostructure/mdf_builder.h"
#include "processing/mesostructure/merge.h"
#include "protocol/base/program.h"

namespace mesorig::mesostructure {
namespace {

// Depths below the reference plane of all measured texels; the middle one.
double MedianDepth(const btf::Mdf& mdf) {
  std::vector<float> depths;
  for (int v = 0; v < mdf.header().view_count(); ++v) {
    const auto z = static_cast<float>(mdf.header().views[static_cast<size_t>(v)].z);
    const auto distance = mdf.Distance(v), confidence = mdf.Confidence(v);
    for (size_t k = 0; k < distance.size(); ++k) {
      if (confidence[k] > 0) depths.push_back(distance[k] * z);
    }
  }
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return static_cast<double>(*middle);
}

// Of all texels of all views.
double Coverage(const btf::Mdf& mdf) {
  double measured = 0, all = 0;
  for (int v = 0; v < mdf.header().view_count(); ++v) {
    for (const float confidence : mdf.Confidence(v)) {
      measured += confidence > 0 ? 1 : 0, all += 1;
    }
  }
  return measured / all;
}

}  // namespace

StatusOr<btf::Mdf> MdfBuilder::MergeViews(const std::vector<const Slot*>& slots,
                                          MdfPackFigures& figures) const {
  std::vector<Vec3> positions;
  for (const Slot* slot : slots) positions.push_back(slot->camera_position);
  const Product& product = plan_.product;
  const assemble::MergedPositions views =
      assemble::MergePositions(positions, {0, 0, product.h_ref_mm});
  btf::MdfHeader header;
  header.width = product.width_px, header.height = product.height_px;
  header.pitch_mm = product.pitch_mm, header.h_ref_mm = product.h_ref_mm;
  header.views = views.directions, header.view_positions_mm = views.positions_mm;
  MESORIG_RETURN_IF_ERROR(btf::CheckMdfHeader(header));
  btf::Mdf mdf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    std::vector<btf::Mdf> images;
    for (size_t k = 0; k < slots.size(); ++k) {
      if (views.index_of[k] != v || slots[k]->empty) continue;
      MESORIG_ASSIGN_OR_RETURN(btf::Mdf image, btf::ReadMdf(PathOf(*slots[k])));
      if (image.header().width != header.width || image.header().height != header.height ||
          image.header().view_count() != 1) {
        return DataLoss("{}: is not what was written", PathOf(*slots[k]).string());
      }
      images.push_back(std::move(image));
    }
    figures.images += static_cast<uint32_t>(images.size());
    MergeImages(images, mdf.MutableDistance(v), mdf.MutableConfidence(v));
  }
  return mdf;
}

StatusOr<btf::Mdf> MdfBuilder::Build(MdfPackFigures& figures) {
  std::vector<const Slot*> durable;
  for (Slot& slot : slots_) {
    MutexLock lock(*camera_mutexes_[static_cast<size_t>(slot.camera)]);
    if (slot.active != nullptr && slot.durable_sequence == 0) {
      MESORIG_RETURN_IF_ERROR(Finish(slot));
    }
    if (slot.durable_sequence != 0) durable.push_back(&slot);
  }
  const SweepTally counts = tally();
  if (counts.images == counts.images_empty) {
    return FailedPrecondition(
        "no displacement image: {} of {} frames of sweeps arrived, {} refused{}{}{}{}",
        counts.frames, frames_planned_, counts.refused, counts.first_refusal.empty() ? "" : ": ",
        counts.first_refusal, counts.first_empty.empty() ? "" : "; ", counts.first_empty);
  }
  figures = {};
  MESORIG_ASSIGN_OR_RETURN(btf::Mdf mdf, MergeViews(durable, figures));
  figures.views = mdf.header().view_count();
  figures.coverage = Coverage(mdf);
  if (!(figures.coverage > 0)) return FailedPrecondition("no texel of the MDF was measured");
  const double depth = MedianDepth(mdf);
  for (int v = 0; v < figures.views; ++v) {
    const auto distance = mdf.MutableDistance(v);
    if (FillHoles(mdf.header().width, mdf.header().height, distance, mdf.Confidence(v))) continue;
    // A view that nothing was seen of: a plane at the middle height of the others.
    const double z = mdf.header().views[static_cast<size_t>(v)].z;
    std::fill(distance.begin(), distance.end(), static_cast<float>(depth / z));
  }
  return mdf;
}

std::string MdfBuilder::Provenance(std::string_view session_id,
                                   std::string_view audit_head) const {
  const SweepTally counts = tally();
  nlohmann::json json{{"session", session_id},
                        {"plan", plan_.name},
                        {"sample", plan_.sample_name},
                        {"rig", rig_.name},
                        {"rig_sha256", rig_.sha256},
                        {"plan_sha256", plan_sha256_},
                        {"program", fmt::format("mesorig-processd {}", kVersion)},
                        {"frames", counts.frames},
                        {"frames_planned", frames_planned_},
                        {"frames_superseded", counts.superseded},
                        {"frames_refused", counts.refused},
                        {"images", counts.images},
                        {"images_empty", counts.images_empty}};
  if (!audit_head.empty()) json["audit_head"] = audit_head;
  return json.dump();
}

StatusOr<MdfPackFigures> MdfBuilder::Pack(const std::filesystem::path& path,
                                          std::string_view session_id,
                                          std::string_view audit_head) {
  MdfPackFigures figures;
  MESORIG_ASSIGN_OR_RETURN(btf::Mdf mdf, Build(figures));
  mdf.mutable_header().provenance_json = Provenance(session_id, audit_head);
  MESORIG_RETURN_IF_ERROR(btf::WriteMdf(mdf, path));
  std::error_code error;
  figures.bytes = std::filesystem::file_size(path, error);
  if (error) return Unavailable("{}: {}", path.string(), error.message());
  return figures;
}

}  // namespace mesorig::mesostructure
