#include "tests/bench/pattern_source.h"

#include <sys/resource.h>

#include <random>

#include "protocol/base/check.h"
#include "protocol/base/file_writer.h"

namespace mesorig::bench {
namespace {

constexpr int kWidth = 1024, kHeight = 768;
constexpr size_t kBuffers = 4;

Rig PatternRig(const std::filesystem::path& source_dir, int bytes_per_pixel) {
  auto rig = LoadRig(source_dir / "rigs/wang2005.toml");
  MESORIG_CHECK(rig.ok() && rig->cameras.size() == kCameras);
  for (mesorig::Camera& camera : rig->cameras) {
    MESORIG_CHECK(camera.width == kWidth && camera.height == kHeight);
    camera.width = kWidth * bytes_per_pixel;
    camera.bits = 8;
  }
  return *std::move(rig);
}

}  // namespace

CompiledPlan PatternPlan(const Rig& rig, uint32_t shots) {
  CompiledPlan plan;
  plan.name = "pattern";
  plan.sample_name = "pattern";
  plan.rig_sha256 = rig.sha256;
  plan.product = {4, 4, 1, 1};
  for (uint32_t shot = 0; shot < shots; ++shot) {
    Step step;
    step.kind = StepKind::kShot;
    step.shot = shot;
    step.exposure_s = 0.02;
    step.cameras = {0, 1, 2, 3, 4, 5, 6, 7};
    plan.steps.push_back(std::move(step));
  }
  plan.shots = shots;
  plan.frames = shots * kCameras;
  return plan;
}

PatternSource::PatternSource(const std::filesystem::path& source_dir, Pixels pixels, uint32_t shots)
    : rig_(PatternRig(source_dir, pixels == Pixels::kRgb ? 3 : 1)),
      plan_(PatternPlan(rig_, shots)),
      buffers_(kBuffers) {
  std::mt19937_64 random(1);
  for (auto& shot : buffers_) {
    for (auto& buffer : shot) {
      auto bytes = std::make_shared<std::string>(rig_.cameras[0].frame_bytes(), '\0');
      for (size_t i = 0; i + 8 <= bytes->size(); i += 8) {
        const uint64_t noise = random();
        std::memcpy(bytes->data() + i, &noise, 8);
      }
      buffer = std::move(bytes);
    }
  }
}

daemon::FrameRecord PatternSource::RecordOf(uint32_t shot, int camera,
                                            std::chrono::steady_clock::time_point trigger) const {
  daemon::FrameRecord record;
  record.camera = camera;
  record.shot = shot;
  record.trigger_id = shot + 1;
  record.frame_id = shot + 1;
  record.exposure_start_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(trigger.time_since_epoch()).count();
  record.exposure_end_ns = record.exposure_start_ns;
  record.exposure_s = 0.02;
  record.axis_rad.assign(rig_.axes.size(), 0);
  record.lamp_level.assign(rig_.lamps.size(), 0);
  record.width = rig_.cameras[0].width;
  record.height = rig_.cameras[0].height;
  record.bits = 8;
  return record;
}

Status PatternSource::Shoot(daemon::Session& session, uint32_t shot,
                            std::chrono::steady_clock::time_point trigger) const {
  for (int camera = 0; camera < kCameras; ++camera) {
    MESORIG_RETURN_IF_ERROR(
        session.Append(RecordOf(shot, camera, trigger), PixelsOf(shot, camera)));
  }
  return OkStatus();
}

double CpuSeconds() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace mesorig::bench
