#pragma once
// Is a raw frame worth keeping? Figures of a picture, and when somebody should look at it. Pure but
// for PictureAlarms, which remembers; of one thread.

#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "protocol/rig/rig.h"

namespace mesorig::daemon {

struct PictureFigures {
  size_t pixels = 0;     // that were looked at
  size_t saturated = 0;  // at the largest code value
  size_t dark = 0;       // within 3 sigma of read noise of black
  double sharpness = 0;  // gradient energy / signal energy, over pixels of one colour; 0: no signal
  double saturated_fraction() const { return pixels == 0 ? 0 : double(saturated) / double(pixels); }
  double dark_fraction() const { return pixels == 0 ? 0 : double(dark) / double(pixels); }
};

// `pixels`: width x height of the camera's bits, as in CapturedFrame. Looks at one cell of the
// Bayer pattern in `stride` x `stride` cells (1: at every pixel).
PictureFigures MeasurePicture(const mesorig::Camera& camera, int width, int height,
                              std::string_view pixels, int stride);
// So that about 16,000 pixels are looked at.
int StrideFor(int width, int height);

// Mean |a - b| over mean (a - black): how different two pictures of one thing are. InvalidArgument
// when they are not of one size; a reference without light compares as 0 when both are black.
StatusOr<double> RelativeDifference(const mesorig::Camera& camera, std::string_view reference,
                                    std::string_view again);

// A sound rig passes: its grazing lamps leave oblique cameras nearly dark, and an anisotropic sample
// has half the contrast in another direction.
struct AlarmLimits {
  double saturated_fraction = 0.02;
  double dark_fraction = 0.995;
  double sharpness_of_median = 0.2;  // of the last frames of this camera under this lamp
  size_t frames_for_median = 5;      // fewer say nothing
};

// Once for each camera and kind until a picture of that camera is good again.
class PictureAlarms {
 public:
  explicit PictureAlarms(AlarmLimits limits = {}) : limits_(limits) {}
  // Texts of alarms that are new with this picture.
  std::vector<std::string> Judge(int camera, const std::string& camera_name, int lamp,
                                 const PictureFigures& figures);

 private:
  enum Kind { kSaturated, kDark, kBlurred };
  bool IsNew(int camera, Kind kind, bool bad);
  static double Median(const std::deque<double>& values);

  const AlarmLimits limits_;
  std::map<std::pair<int, Kind>, bool> raised_;
  std::map<std::pair<int, int>, std::deque<double>> sharpness_;  // by camera and lamp
};

}  // namespace mesorig::daemon
