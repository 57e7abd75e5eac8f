#include "daemon/control/shot_book.h"

#include <algorithm>

namespace mesorig::daemon {

ShotBook::ShotBook(const RunContext& context) : context_(context) { Recount(); }

void ShotBook::Recount() {
  progress_.shots_done = 0;
  progress_.bytes_left = 0;
  for (const Step& step : context_.plan.steps) {
    const bool sweep = step.kind == StepKind::kSweep;
    if (!sweep && step.kind != StepKind::kShot) continue;
    for (uint32_t i = 0; i < (sweep ? step.sweep.frames : 1); ++i) {
      const std::vector<int> owed = Owed(step, i);
      progress_.shots_done += owed.empty();
      for (const int camera : owed) {
        const mesorig::Camera& description = context_.rig.cameras[camera];
        const auto k = static_cast<size_t>(
            std::find(step.cameras.begin(), step.cameras.end(), camera) - step.cameras.begin());
        const Region region = sweep ? step.sweep.regions[k] : description.full_region();
        progress_.bytes_left += static_cast<uint64_t>(region.width) *
                                static_cast<uint64_t>(region.height) *
                                static_cast<uint64_t>(description.bytes_per_pixel());
      }
    }
  }
}

std::vector<int> ShotBook::Owed(const Step& step, uint32_t index) const {
  const std::vector<int> missing = context_.session.Missing(step.shot + index);
  std::vector<int> owed;
  std::set_intersection(missing.begin(), missing.end(), step.cameras.begin(), step.cameras.end(),
                        std::back_inserter(owed));
  return owed;
}

bool ShotBook::OwesAnything(const Step& step) const {
  if (step.kind == StepKind::kShot) return !Owed(step).empty();
  if (step.kind != StepKind::kSweep) return false;
  for (uint32_t i = 0; i < step.sweep.frames; ++i) {
    if (!Owed(step, i).empty()) return true;
  }
  return false;
}

uint32_t ShotBook::ShotsOwed() const {
  uint32_t owed = 0;
  for (uint32_t shot = 0; shot < context_.plan.shots; ++shot) {
    owed += !context_.session.Missing(shot).empty();
  }
  return owed;
}

void ShotBook::SetReadBack(std::vector<double> axis_rad, std::vector<double> lamp_level) {
  axis_rad_ = std::move(axis_rad);
  lamp_level_ = std::move(lamp_level);
}

FrameRecord ShotBook::MakeRecord(const Step& step, double exposure_s, const Region& region,
                                 const CapturedFrame& frame, int camera) const {
  FrameRecord record;
  record.camera = camera;
  record.shot = step.shot;
  record.trigger_id = frame.trigger_id;
  record.frame_id = frame.frame_id;
  record.exposure_start_ns = frame.exposure_start.count();
  record.exposure_end_ns = frame.exposure_end.count();
  record.exposure_s = exposure_s;
  record.axis_rad = axis_rad_;
  record.lamp_level = lamp_level_;
  record.width = frame.width;
  record.height = frame.height;
  record.bits = frame.bits;
  record.region_x = region.x;
  record.region_y = region.y;
  return record;
}

Status ShotBook::Keep(Status of_session) {
  session_broken_ = session_broken_ || !of_session.ok();
  return of_session;
}

Status ShotBook::Append(FrameRecord record, const CapturedFrame& frame) {
  MESORIG_RETURN_IF_ERROR(Keep(context_.session.Append(std::move(record), frame.pixels)));
  ++progress_.frames;
  progress_.bytes_left -= std::min<uint64_t>(progress_.bytes_left, frame.pixels->size());
  return OkStatus();
}

Status ShotBook::Record(JournalKind kind, int index, double value, std::string text) {
  return Keep(
      context_.session.Record({kind, context_.clock.Now().count(), index, value, std::move(text)}));
}

Status ShotBook::Judge(const Step& step, int lamp, int camera, const CapturedFrame& frame) {
  const bool shows_the_sample = step.purpose == Purpose::kData && lamp >= 0;
  if (!shows_the_sample) return OkStatus();
  const mesorig::Camera& description = context_.rig.cameras[camera];
  const PictureFigures figures = MeasurePicture(
      description, frame.width, frame.height, *frame.pixels, StrideFor(frame.width, frame.height));
  for (const std::string& alarm : alarms_.Judge(camera, description.name, lamp, figures)) {
    const std::string text = fmt::format("shot {}: {}", step.shot, alarm);
    context_.on_alarm(camera, text);
    MESORIG_RETURN_IF_ERROR(Record(JournalKind::kAlarm, camera, 0, text));
  }
  return OkStatus();
}

void ShotBook::ShotDone() {
  ++progress_.shots_done;
  context_.on_progress(progress_);
}

}  // namespace mesorig::daemon
