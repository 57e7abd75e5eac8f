#include "protocol/rig/rig.h"

namespace mesorig {
namespace {

template <typename T>
std::optional<int> FindByName(const std::vector<T>& items, std::string_view name) {
  for (size_t i = 0; i < items.size(); ++i) {
    if (items[i].name == name) return static_cast<int>(i);
  }
  return std::nullopt;
}

}  // namespace

std::optional<int> Rig::FindAxis(std::string_view n) const { return FindByName(axes, n); }
std::optional<int> Rig::FindFrame(std::string_view n) const { return FindByName(frames, n); }
std::optional<int> Rig::FindLamp(std::string_view n) const { return FindByName(lamps, n); }
std::optional<int> Rig::FindCamera(std::string_view n) const { return FindByName(cameras, n); }
std::optional<int> Rig::FindMount(std::string_view n) const {
  return laser ? FindByName(laser->mounts, n) : std::nullopt;
}

}  // namespace mesorig
