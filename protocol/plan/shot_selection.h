#pragma once
// Which frames of a plan a person means: "shots 10-20, camera cam3".

#include <cstdint>
#include <string_view>
#include <vector>

#include "protocol/plan/plan.h"

namespace mesorig {

// Shots ascending, each once; of a shot the cameras ascending, at least one.
struct SelectedShot {
  uint32_t shot = 0;
  std::vector<int> cameras;
};
using ShotSelection = std::vector<SelectedShot>;

// The text is a list of terms, separated by commas; what a frame must meet is one term of each kind
// that is there:
//   shot 7, shots 10-20      numbers as the plan counts them, from 0, both ends included
//   camera cam3              a camera by its name
//   lamp lamp0               shots under this lamp, by its name
//   sweep 4                  all shots of a sweep of the laser
//   dark, ambient, flat, data   shots for this purpose (sweeps are data)
// So "shots 1-5, shot 9, camera a, camera b" are the frames of two cameras at six shots. A name
// that holds a comma or a space stands in double quotes. InvalidArgument names the term: unknown
// words and names, numbers beyond the plan, a selection that no frame of the plan meets.
StatusOr<ShotSelection> ParseShotSelection(std::string_view text, const CompiledPlan& plan,
                                           const Rig& rig);

}  // namespace mesorig
