#include "protocol/plan/stations.h"

#include <algorithm>
#include <optional>

#include "protocol/plan/needs.h"
#include "protocol/rig/rig_geometry.h"

namespace mesorig {
namespace {

// A lamp or a camera as a station has it.
struct Seen {
  int index = -1;
  Vec3 direction;  // from the middle of the reference plane, sample frame
  std::optional<std::string> blocked_by;
};

Status BelowHorizon(const std::string& where, const char* what, const std::string& name,
                    Vec3 direction) {
  const double above = DegFromRad(std::asin(std::clamp(direction.z, -1.0, 1.0)));
  return InvalidArgument(
      "{}: {} {} stands {:.2f} deg above the horizon of the reference plane: not "
      "a direction of the sample",
      where, what, name, above);
}

class StationReader {
 public:
  StationReader(const Rig& rig, double h_ref_mm) : rig_(rig), centre_{0, 0, h_ref_mm} {}

  StatusOr<std::vector<Seen>> Lamps(const Station& station, const std::string& where) const {
    std::vector<Seen> lamps;
    for (const int l : station.lamps) {
      const Vec3 d = Normalized(LampInSample(rig_, l, station.axis_rad) - centre_);
      if (!(d.z > 0)) return BelowHorizon(where, "lamp", rig_.lamps[l].name, d);
      lamps.push_back(
          {l, d, BlockedBy(rig_, LampInWorld(rig_, l, station.axis_rad), station.axis_rad)});
    }
    return lamps;
  }
  StatusOr<std::vector<Seen>> Cameras(const Station& station, const std::string& where) const {
    std::vector<Seen> cameras;
    for (const int c : station.cameras) {
      const Vec3 d = Normalized(SampleFromCamera(rig_, c, station.axis_rad).translation - centre_);
      if (!(d.z > 0)) return BelowHorizon(where, "camera", rig_.cameras[c].name, d);
      const Vec3 p = WorldFromCamera(rig_, c, station.axis_rad).translation;
      cameras.push_back({c, d, BlockedBy(rig_, p, station.axis_rad)});
    }
    return cameras;
  }

 private:
  const Rig& rig_;
  const Vec3 centre_;
};

std::vector<Station> StationsOf(const DirectionSet& set) {
  if (!set.is_grid) return set.stations;
  std::vector<Station> stations;
  for (const auto& axis_rad : Combinations(set.axis_rad)) {
    stations.push_back({axis_rad, set.lamps, set.cameras, set.where});
  }
  return stations;
}

// "lamp0 by housing of cam3", the first of them.
std::string WhatBlocks(const Rig& rig, const std::vector<Seen>& lamps,
                       const std::vector<Seen>& cameras) {
  for (const Seen& lamp : lamps) {
    if (lamp.blocked_by)
      return fmt::format("lamp {} by {}", rig.lamps[lamp.index].name, *lamp.blocked_by);
  }
  for (const Seen& camera : cameras) {
    if (camera.blocked_by)
      return fmt::format("camera {} by {}", rig.cameras[camera.index].name, *camera.blocked_by);
  }
  return "nothing";
}

// Pairs of lamps and cameras that nothing blocks; how many others there are goes into the set.
LitStation Light(const Station& station, const std::vector<Seen>& lamps,
                 const std::vector<Seen>& cameras, NeededPairs& needed, uint32_t frames_a_pair,
                 LitSet& set) {
  LitStation lit_station{station.axis_rad, {}};
  for (const Seen& lamp : lamps) {
    LitStation::Lit lit{lamp.index, {}};
    for (const Seen& camera : cameras) {
      if (lamp.blocked_by || camera.blocked_by) {
        set.frames_blocked += frames_a_pair;
      } else if (!needed.Take(camera.direction, lamp.direction)) {
        set.frames_unneeded += frames_a_pair;
      } else {
        lit.cameras.push_back(camera.index);
      }
    }
    if (!lit.cameras.empty()) lit_station.lit.push_back(std::move(lit));
  }
  return lit_station;
}

}  // namespace

std::vector<std::vector<double>> Combinations(const std::vector<std::vector<double>>& axis_rad) {
  std::vector<std::vector<double>> all{{}};
  for (const auto& angles : axis_rad) {
    std::vector<std::vector<double>> longer;
    for (const auto& start : all) {
      for (const double angle : angles) {
        longer.push_back(start);
        longer.back().push_back(angle);
      }
    }
    all = std::move(longer);
  }
  return all;
}

std::vector<int> UnblockedCameras(const Rig& rig, const std::vector<int>& cameras,
                                  const std::vector<double>& axis_rad) {
  std::vector<int> free;
  for (const int c : cameras) {
    const Vec3 camera = WorldFromCamera(rig, c, axis_rad).translation;
    if (!BlockedBy(rig, camera, axis_rad)) free.push_back(c);
  }
  return free;
}

StatusOr<LitSet> LightStations(const Rig& rig, const DirectionSet& set, const Needs& needs,
                               double h_ref_mm) {
  const StationReader reader(rig, h_ref_mm);
  const size_t shots = set.exposures.metered() ? 1 : set.exposures.bracket_s.size();
  const auto frames_a_pair = static_cast<uint32_t>(shots) * set.repeats;
  NeededPairs needed(needs);
  LitSet lit_set;
  uint32_t open = 0;  // pairs that nothing blocks
  std::string first_block;
  for (const Station& station : StationsOf(set)) {
    MESORIG_ASSIGN_OR_RETURN(const auto lamps, reader.Lamps(station, station.where));
    MESORIG_ASSIGN_OR_RETURN(const auto cameras, reader.Cameras(station, station.where));
    const uint32_t blocked_before = lit_set.frames_blocked;
    lit_set.stations.push_back(Light(station, lamps, cameras, needed, frames_a_pair, lit_set));
    const auto pairs = static_cast<uint32_t>(lamps.size() * cameras.size());
    const uint32_t blocked = (lit_set.frames_blocked - blocked_before) / frames_a_pair;
    open += pairs - blocked;
    if (blocked > 0 && first_block.empty()) first_block = WhatBlocks(rig, lamps, cameras);
    if (blocked < pairs || set.is_grid) continue;
    return InvalidArgument("{}: nothing can be seen here: {}", station.where,
                           WhatBlocks(rig, lamps, cameras));
  }
  if (open == 0) {
    return InvalidArgument("{}: solids of the rig block every frame ({} of {}), the first: {}",
                           set.where, lit_set.frames_blocked, lit_set.frames_blocked, first_block);
  }
  return lit_set;
}

}  // namespace mesorig
