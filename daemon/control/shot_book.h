#pragma once
// What a run has taken and still owes: frames go from here to the session, and are counted.

#include <map>
#include <vector>

#include "daemon/control/camera_array.h"
#include "daemon/control/picture.h"
#include "daemon/control/run_context.h"

namespace mesorig::daemon {

// Of one run, on the sequencer's thread.
class ShotBook {
 public:
  explicit ShotBook(const RunContext& context);  // borrowed; asks the session what is missing

  // Cameras of the step (frame `index` of it, for a sweep) whose frame is still missing.
  std::vector<int> Owed(const Step& step, uint32_t index = 0) const;
  bool OwesAnything(const Step& step) const;
  // Of the whole plan.
  uint32_t ShotsOwed() const;
  // Asks the session again what is missing.
  void Recount();

  // What was read back for the shots that follow.
  void SetReadBack(std::vector<double> axis_rad, std::vector<double> lamp_level);
  FrameRecord MakeRecord(const Step& step, double exposure_s, const Region& region,
                         const CapturedFrame& frame, int camera) const;
  // To the session. An error is the session's: nothing else can be taken any more.
  Status Append(FrameRecord record, const CapturedFrame& frame);
  Status Record(JournalKind kind, int index, double value, std::string text);
  // Raises alarms on a picture of the sample that somebody should look at.
  Status Judge(const Step& step, int lamp, int camera, const CapturedFrame& frame);
  // A shot has all its frames.
  void ShotDone();

  void TrySession() { session_broken_ = false; }
  bool session_broken() const { return session_broken_; }
  const RunProgress& progress() const { return progress_; }

 private:
  Status Keep(Status of_session);

  const RunContext& context_;
  RunProgress progress_;
  PictureAlarms alarms_;
  bool session_broken_ = false;
  std::vector<double> axis_rad_, lamp_level_;
};

}  // namespace mesorig::daemon
