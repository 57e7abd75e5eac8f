#include "processing/service/session_products.h"

#include "protocol/base/log.h"

namespace mesorig::service {
namespace {

assemble::FrameInfo InfoOf(const v1::FrameHeader& header) {
  return {header.sequence(),
          static_cast<int>(header.camera()),
          header.shot(),
          header.exposure_s(),
          {header.axis_rad().begin(), header.axis_rad().end()},
          {header.lamp_level().begin(), header.lamp_level().end()}};
}

mesostructure::SweepFrame SweepFrameOf(const v1::FrameHeader& header) {
  const v1::LaserState& laser = header.laser();
  mesostructure::SweepFrame frame;
  frame.sequence = header.sequence();
  frame.camera = static_cast<int>(header.camera());
  frame.shot = header.shot();
  frame.exposure_s = header.exposure_s();
  frame.axis_rad = {header.axis_rad().begin(), header.axis_rad().end()};
  frame.lamp_level = {header.lamp_level().begin(), header.lamp_level().end()};
  frame.sweep = laser.sweep(), frame.index = laser.index();
  frame.mount = static_cast<int>(laser.mount());
  frame.tilt_rad = laser.tilt_rad(), frame.on = laser.on();
  frame.region = {static_cast<int>(header.region_x()), static_cast<int>(header.region_y()),
                  static_cast<int>(header.width()), static_cast<int>(header.height())};
  return frame;
}

}  // namespace

SessionProducts::SessionProducts(const CompiledPlan& plan, std::filesystem::path folder)
    : folder_(std::move(folder)), has_data_(assemble::Assembler::HasData(plan)) {
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kSweep) released_by_plan_.push_back(step.sweep.keep_frames ? 0 : 1);
  }
}

StatusOr<std::unique_ptr<SessionProducts>> SessionProducts::Create(
    const Rig& rig, const CompiledPlan& plan, const std::filesystem::path& folder) {
  std::unique_ptr<SessionProducts> products(new SessionProducts(plan, folder));
  if (assemble::Assembler::HasShots(plan)) {
    MESORIG_ASSIGN_OR_RETURN(products->assembler_,
                             assemble::Assembler::Create(rig, plan, folder / "frames.work"));
  }
  if (mesostructure::MdfBuilder::HasSweeps(plan)) {
    MESORIG_ASSIGN_OR_RETURN(products->mdf_builder_,
                             mesostructure::MdfBuilder::Create(rig, plan, DisplacementsPath(folder)));
  }
  return products;
}

Status SessionProducts::Take(const v1::Frame& frame) {
  const v1::FrameHeader& header = frame.header();
  if (header.has_laser()) {
    if (mdf_builder_ != nullptr) return mdf_builder_->Add(SweepFrameOf(header), frame.pixels());
    return InvalidArgument("shot {}: a frame of a sweep, the plan has none", header.shot());
  }
  if (assembler_ == nullptr) {
    return InvalidArgument("shot {}: a frame of lamps, the plan has only sweeps", header.shot());
  }
  MESORIG_RETURN_IF_ERROR(assembler_->Add(InfoOf(header), frame.pixels()));
  ++lamp_frames_;
  return OkStatus();
}

uint32_t SessionProducts::progress() const {
  return lamp_frames_ + (mdf_builder_ != nullptr ? mdf_builder_->tally().frames : 0);
}

uint32_t SessionProducts::frames() const {
  uint32_t frames = assembler_ != nullptr ? assembler_->tally().frames : 0;
  if (mdf_builder_ != nullptr) frames += mdf_builder_->tally().frames;
  return frames;
}

uint32_t SessionProducts::frames_planned() const {
  uint32_t frames = assembler_ != nullptr ? assembler_->frames_planned() : 0;
  if (mdf_builder_ != nullptr) frames += mdf_builder_->frames_planned();
  return frames;
}

std::vector<uint32_t> SessionProducts::TakeReleasable() {
  if (mdf_builder_ == nullptr) return {};
  std::vector<uint32_t> sweeps = mdf_builder_->TakeReleasable();
  std::erase_if(sweeps, [this](uint32_t sweep) { return released_by_plan_[sweep] == 0; });
  return sweeps;
}

Status SessionProducts::CheckWhole() const {
  if (frames() == frames_planned()) return OkStatus();
  return DataLoss("{} of {} planned frames arrived", frames(), frames_planned());
}

StatusOr<v1::Product> SessionProducts::PackBtf(const std::string& session_id,
                                                const std::string& audit_head) {
  const std::filesystem::path path = BtfPath(folder_);
  MESORIG_ASSIGN_OR_RETURN(const assemble::PackFigures figures,
                           assembler_->Pack(path, session_id, audit_head));
  const assemble::Tally tally = assembler_->tally();
  if (tally.refused > 0) {
    Log("processing").warn("session {}: {} frames refused, first: {}", session_id, tally.refused,
                 tally.first_refusal);
  }
  if (figures.clipped_texels > 0) {
    Log("processing").warn("session {}: {} texels are lower bounds (saturated pixels)", session_id,
                 figures.clipped_texels);
  }
  if (tally.ambient + tally.dark > 0) {
    Log("processing").info("session {}: black levels from {} frames of ambient light and {} dark ones",
                 session_id, tally.ambient, tally.dark);
  }
  if (tally.flat > 0) {
    Log("processing").info("session {}: {} flat frames are stored, not used yet", session_id, tally.flat);
  }
  Log("processing").info("session {}: {} ({} views, {} lights, {} pairs, {} frames merged)", session_id,
               path.string(), figures.views, figures.lights, figures.pairs, figures.merged_frames);
  return ProductOf("btf", path, figures.bytes);
}

StatusOr<v1::Product> SessionProducts::PackMdf(const std::string& session_id,
                                                const std::string& audit_head) {
  const std::filesystem::path path = MdfPath(folder_);
  MESORIG_ASSIGN_OR_RETURN(const mesostructure::MdfPackFigures figures,
                           mdf_builder_->Pack(path, session_id, audit_head));
  const mesostructure::SweepTally tally = mdf_builder_->tally();
  if (tally.images_empty > 0) {
    Log("processing").warn("session {}: {} of {} displacement images are empty, first: {}", session_id,
                 tally.images_empty, tally.images, tally.first_empty);
  }
  Log("processing").info(
      "session {}: {} ({} views, {} displacement images, {:.1f} % measured; {} of {} "
      "frames without a plane)",
      session_id, path.string(), figures.views, figures.images, 100 * figures.coverage,
      tally.refused, tally.frames);
  return ProductOf("mdf", path, figures.bytes);
}

StatusOr<std::vector<v1::Product>> SessionProducts::Pack(const std::string& session_id,
                                                             const std::string& audit_head) {
  std::vector<v1::Product> products;
  if (has_data_) {
    MESORIG_ASSIGN_OR_RETURN(v1::Product btf, PackBtf(session_id, audit_head));
    products.push_back(std::move(btf));
  }
  if (mdf_builder_ != nullptr) {
    MESORIG_ASSIGN_OR_RETURN(v1::Product mdf, PackMdf(session_id, audit_head));
    products.push_back(std::move(mdf));
  }
  if (products.empty()) {
    Log("processing").info("session {}: only calibration frames: there is nothing to pack", session_id);
  }
  return products;
}

}  // namespace mesorig::service
