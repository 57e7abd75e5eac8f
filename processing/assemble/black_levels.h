#pragma once
// What each pixel reads without the lamps, from a session's own ambient and dark frames: their mean
// comes in place of the rig file's black level.

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "processing/assemble/work_file.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::assemble {

// Thread contract: calls for different cameras may run side by side, those for one must not.
class BlackLevels {
 public:
  // Errors as WorkFile::Create. The file holds the frames, so that one that is shot again replaces
  // its predecessor.
  static StatusOr<BlackLevels> Create(const Rig& rig, const CompiledPlan& plan,
                                      const std::filesystem::path& work_file);
  // A frame of an ambient or dark shot. Errors as image::ReadCodes.
  Status Add(const Camera& description, int camera, uint32_t shot, std::string_view pixels);
  // One a pixel, in code values: the mean of the frames that have arrived of this camera and
  // exposure, of ambient light if the plan has such, else of the dark. Empty when there is none.
  // Valid until the next call for this camera.
  std::span<const float> Of(int camera, double exposure_s);
  // Grows with every frame of this camera.
  uint64_t version(int camera) const { return cameras_[static_cast<size_t>(camera)].version; }

 private:
  struct Picture {
    uint32_t shot = 0;
    double exposure_s = 0;
    bool ambient = false, arrived = false;
    size_t slot = 0;
  };
  struct CameraState {
    size_t pixels = 0;
    std::vector<Picture> pictures;  // in the order of the plan
    uint64_t version = 0, mean_version = 0;
    double mean_exposure_s = 0;
    std::vector<float> mean;  // of mean_exposure_s, at mean_version
  };
  BlackLevels() = default;

  std::vector<CameraState> cameras_;
  std::optional<WorkFile> work_;  // nothing: the plan has no such frames
};

}  // namespace mesorig::assemble
