#pragma once
// Eight cameras without a rig: frames of 1024 x 768 pixels, made before the clock runs.

#include <array>
#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::bench {

inline constexpr int kCameras = 8;

// What a pixel is on its way to the disk: raw Bayer, one byte, or RGB, three (as a picture of three
// times the width).
enum class Pixels { kBayer, kRgb };

// So many shots of all cameras.
CompiledPlan PatternPlan(const Rig& rig, uint32_t shots);

class PatternSource {
 public:
  // `folder` holds the repository's rigs/.
  PatternSource(const std::filesystem::path& source_dir, Pixels pixels, uint32_t shots);
  const Rig& rig() const { return rig_; }
  const CompiledPlan& plan() const { return plan_; }
  size_t frame_bytes() const { return buffers_[0][0]->size(); }
  size_t shot_bytes() const { return frame_bytes() * kCameras; }
  // Of shot and camera; a few buffers take turns.
  const std::shared_ptr<const std::string>& PixelsOf(uint32_t shot, int camera) const {
    return buffers_[shot % buffers_.size()][static_cast<size_t>(camera)];
  }
  // exposure_start_ns is `trigger` on the steady clock, which all processes share.
  daemon::FrameRecord RecordOf(uint32_t shot, int camera,
                               std::chrono::steady_clock::time_point trigger) const;
  // One trigger. The error of Append.
  Status Shoot(daemon::Session& session, uint32_t shot,
               std::chrono::steady_clock::time_point trigger) const;

 private:
  Rig rig_;
  CompiledPlan plan_;
  std::vector<std::array<std::shared_ptr<const std::string>, kCameras>> buffers_;
};

// User and system time of this process so far, s.
double CpuSeconds();
inline double SecondsSince(std::chrono::steady_clock::time_point then) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - then).count();
}

}  // namespace mesorig::bench
