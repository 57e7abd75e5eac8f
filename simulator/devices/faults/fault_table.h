#pragma once
// All that can be injected, in one table: scripts are checked against it before a run begins, and
// the help of `mesorig-sim inject` is written from it. What the words do is at the devices.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/rig/rig.h"

namespace mesorig::simulator {

struct FaultKind {
  enum class Of { kAny, kAxis, kLamps, kNxt, kLines, kCamera, kRig } of{};
  std::string_view usage;    // "drop [N] [in|out]"; its first word is the fault's
  std::string_view meaning;  // for people
};
const std::vector<FaultKind>& AllFaults();

// InvalidArgument when this rig has no such device, or the device no such fault. `text` is DEVICE
// FAULT...; what only the moment tells (a door that is closed) is not looked at.
Status CheckFault(const Rig& rig, std::string_view text);
// The table for people, one fault a line, with this indent.
std::string FaultHelp(std::string_view indent);

std::vector<std::string_view> FaultWords(std::string_view text);  // parted by spaces
// A whole number in [low, high] at `words[at]`, or `otherwise` when the words end before.
// InvalidArgument names words[0], the fault.
Status FaultNumber(const std::vector<std::string_view>& words, size_t at, uint32_t low,
                   uint32_t high, std::optional<uint32_t> otherwise, uint32_t& number);
// Likewise a number with a fraction.
Status FaultReal(const std::vector<std::string_view>& words, size_t at, double low, double high,
                 double& number);

}  // namespace mesorig::simulator
