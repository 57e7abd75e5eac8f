#include "daemon/control/frame_check.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kClockSlack{1'000'000};  // between the camera's clock and the rig's

}  // namespace

Status CheckFrame(const mesorig::Camera& camera, const ExpectedFrame& expected,
                  const CapturedFrame& frame, RigTime now) {
  const auto bad = [&](std::string_view what) {
    return DataLoss("camera {}: frame {} of trigger {}: {}", camera.name, frame.frame_id,
                    expected.trigger_id, what);
  };
  if (frame.trigger_id != expected.trigger_id) {
    return bad(fmt::format("it is of trigger {}", frame.trigger_id));
  }
  if (expected.last_frame_id != 0 && frame.frame_id <= expected.last_frame_id) {
    return bad(fmt::format("duplicated: frame {} was there already", expected.last_frame_id));
  }
  if (frame.exposure_start < expected.triggered_at - kClockSlack) {
    return bad(fmt::format("stale: exposed from {:.6f} s, triggered at {:.6f} s",
                           Seconds(frame.exposure_start), Seconds(expected.triggered_at)));
  }
  if (frame.exposure_start > expected.deadline) {
    return bad(
        fmt::format("exposed from {:.6f} s, after its deadline at {:.6f} s: its clock jumped",
                    Seconds(frame.exposure_start), Seconds(expected.deadline)));
  }
  const double latency_s = Seconds(frame.exposure_start) - Seconds(expected.triggered_at);
  if (latency_s > camera.trigger_latency_s + Seconds(kClockSlack)) {
    return bad(fmt::format("exposed from {:.6f} s after its trigger on, permitted is {:.6f} s "
                           "(trigger_latency_s): the rig may have moved on",
                           latency_s, camera.trigger_latency_s));
  }
  if (now > expected.deadline) {
    return bad(fmt::format("late: came at {:.6f} s, expected until {:.6f} s", Seconds(now),
                           Seconds(expected.deadline)));
  }
  const size_t bytes = static_cast<size_t>(expected.region.width) *
                       static_cast<size_t>(expected.region.height) *
                       static_cast<size_t>(camera.bytes_per_pixel());
  const size_t came = frame.pixels == nullptr ? 0 : frame.pixels->size();
  if (frame.width != expected.region.width || frame.height != expected.region.height ||
      frame.bits != camera.bits || came != bytes) {
    return bad(
        fmt::format("torn: {} x {} pixels of {} bits, {} bytes; {} x {} of {} bits, {} bytes "
                    "were asked for",
                    frame.width, frame.height, frame.bits, came, expected.region.width,
                    expected.region.height, camera.bits, bytes));
  }
  return OkStatus();
}

}  // namespace mesorig::daemon
