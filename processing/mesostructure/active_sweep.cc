#include "processing/mesostructure/active_sweep.h"

#include <algorithm>
#include <cmath>

#include "processing/image/radiance.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kStandStill = 1e-4;  // rad, about six counts of a rig's encoder
constexpr double kLampOff = 1e-3;     // of full level

Camera OfRegion(const Camera& camera, const Region& region) {
  Camera part = camera;
  part.width = region.width, part.height = region.height;
  return part;
}

CodeScale ScaleOf(const Camera& camera) {
  CodeScale scale;
  scale.black = camera.black_dn;
  scale.electrons_per_code = camera.full_well_e / (camera.white_dn() - camera.black_dn);
  scale.saturated = static_cast<uint16_t>(camera.white_dn() - image::SaturationMarginDn(camera));
  scale.read_noise_e = camera.read_noise_e;
  return scale;
}

}  // namespace

StatusOr<std::unique_ptr<ActiveSweep>> ActiveSweep::Begin(const Rig& rig, const CompiledPlan& plan,
                                                          const Step& step, const SweepFrame& first,
                                                          const Region& region) {
  const Product& product = plan.product;
  const double extent = plan.sample_extent_mm > 0
                            ? plan.sample_extent_mm
                            : product.pitch_mm * std::max(product.width_px, product.height_px);
  MESORIG_ASSIGN_OR_RETURN(SweepGeometry geometry,
                           SweepGeometry::Build(rig, product, extent, first.camera,
                                                step.sweep.mount, first.axis_rad, region));
  return std::unique_ptr<ActiveSweep>(new ActiveSweep(rig, plan, step, std::move(geometry), first));
}

ActiveSweep::ActiveSweep(const Rig& rig, const CompiledPlan& plan, const Step& step,
                         SweepGeometry geometry, const SweepFrame& first)
    : rig_(rig),
      plan_(plan),
      geometry_(std::move(geometry)),
      camera_(OfRegion(rig.cameras[static_cast<size_t>(first.camera)], geometry_.region())),
      axis_rad_(first.axis_rad),
      scale_(ScaleOf(camera_)),
      stack_(geometry_.sample().size(), step.sweep.frames),
      fixes_(step.sweep.frames),
      sequences_(step.sweep.frames) {
  const auto& response = rig.laser->response;
  const double largest = *std::max_element(response.begin(), response.end());
  for (size_t colour = 0; colour < gain_.size(); ++colour) {
    if (!UsefulColour(*rig.laser, static_cast<int>(colour))) continue;
    gain_[colour] = static_cast<float>(largest / response[colour]);
  }
}

Status ActiveSweep::CheckState(const SweepFrame& frame) const {
  if (!frame.on) return FailedPrecondition("the laser was off");
  for (size_t k = 0; k < frame.axis_rad.size(); ++k) {
    if (std::abs(frame.axis_rad[k] - axis_rad_[k]) > kStandStill) {
      return FailedPrecondition(
          "axis {} stands at {:.4f} degrees, at {:.4f} in the sweep's first "
          "frame",
          rig_.axes[k].name, DegFromRad(frame.axis_rad[k]), DegFromRad(axis_rad_[k]));
    }
  }
  for (size_t k = 0; k < frame.lamp_level.size(); ++k) {
    if (frame.lamp_level[k] > kLampOff) {
      return FailedPrecondition("lamp {} shines at {}", rig_.lamps[k].name, frame.lamp_level[k]);
    }
  }
  return OkStatus();
}

Status ActiveSweep::Add(const SweepFrame& frame, std::string_view pixels) {
  MESORIG_ASSIGN_OR_RETURN(const image::MosaicImage mosaic,
                           image::LinearRadiance(camera_, pixels, frame.exposure_s));
  if (sequences_[frame.index] == 0) ++arrived_;
  sequences_[frame.index] = frame.sequence;
  fixes_[frame.index].reset();
  const std::vector<uint32_t>& sample = geometry_.sample();
  const Status state = CheckState(frame);
  const double electrons = camera_.electrons_per_radiance_s * frame.exposure_s;
  for (size_t k = 0; k < sample.size(); ++k) {
    const double e = static_cast<double>(mosaic.radiance[sample[k]]) * electrons;
    const long code = std::lround(scale_.black + e / scale_.electrons_per_code);
    stack_.Set(
        k, frame.index,
        state.ok() ? static_cast<uint16_t>(std::clamp(code, 0L, 0xfffeL)) : FrameStack::kNothing);
  }
  MESORIG_RETURN_IF_ERROR(state);
  StripeImage stripe;
  stripe.width = camera_.width, stripe.height = camera_.height;
  stripe.usable = geometry_.reference();
  stripe.saturation =
      static_cast<float>((scale_.saturated - scale_.black) * scale_.electrons_per_code);
  stripe.value.resize(mosaic.radiance.size());
  for (size_t k = 0; k < stripe.value.size(); ++k) {
    if (stripe.usable[k] == 0) continue;
    const int column = static_cast<int>(k) % camera_.width,
              row = static_cast<int>(k) / camera_.width;
    const int colour = image::ColourAt(camera_.pattern, column, row);
    stripe.value[k] =
        mosaic.radiance[k] * static_cast<float>(electrons) * gain_[static_cast<size_t>(colour)];
  }
  const double worst = static_cast<double>(*std::max_element(gain_.begin(), gain_.end()));
  stripe.noise = scale_.read_noise_e * worst, stripe.shot = worst;
  MESORIG_ASSIGN_OR_RETURN(fixes_[frame.index], FindTilt(geometry_, stripe));
  return OkStatus();
}

uint64_t ActiveSweep::newest() const {
  return *std::max_element(sequences_.begin(), sequences_.end());
}

StatusOr<Displacement> ActiveSweep::Compute() const {
  return ComputeDisplacement(geometry_, plan_.product, scale_, rig_.laser->fwhm_mm, stack_, fixes_);
}

}  // namespace mesorig::mesostructure
