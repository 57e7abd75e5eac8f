#pragma once
// What the rig's cameras see of the sample, as expected electrons: pinhole cameras with box pixels,
// point lamps with irradiance I/d^2, a line laser, masking and shadows. Frames and units as in
// protocol/rig.
//
// First hits depend only on where a camera stands over the sample; they are kept and serve all
// lamps, exposures, light arc angles and laser sheets of one turntable position. A lamp's picture
// at full level is kept as well, for exposure brackets and repeats; of a laser at one place what
// its sheets have met (LaserSheet). What is not the sample (arcs, housings) is black; the turntable
// around it is a diffuse disc at z = 0 that only the laser lights: in the light of lamps it is
// black too. A lamp, laser or camera that a solid hides from part of the sample's disc (BlockedBy)
// is hidden from all of it.
//
// Owned by one thread; uses `threads` of its own inside a call. Borrows rig and world.

#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/rig/rig.h"
#include "protocol/rig/rig_geometry.h"
#include "simulator/world/laser_sheet.h"
#include "simulator/world/transport.h"
#include "simulator/world/world.h"

namespace mesorig::world {

struct LaserState {
  int mount = 0;        // index into Laser::mounts
  double level = 0;     // mean over the exposure, 0..1
  double tilt_rad = 0;  // where the emitter really points, at mid-exposure
};

struct RigState {
  std::vector<double> axis_rad;     // one per Rig::axes
  std::vector<double> lamp_levels;  // one per Rig::lamps: mean over the exposure, 0..1
  LaserState laser = {};            // ignored while its level is 0
};

struct ImageOptions {
  int samples_per_side = 2;  // rays a pixel, along u and along v
  int threads = 2;
  size_t cache_bytes = size_t{512} << 20;
};

class CameraImages {
 public:
  CameraImages(const Rig& rig, const World& world, ImageOptions options)
      : rig_(rig), world_(world), options_(options) {}

  // Electrons of the region's pixels (of the whole sensor without one), row by row; a Bayer pixel
  // sees its own colour. InvalidArgument for a camera, number of axes or lamps, mount or region
  // that the rig has not, an angle that is not finite, a level outside 0..1 or an exposure that is
  // negative or not finite.
  StatusOr<std::vector<float>> ExpectedElectrons(int camera, const RigState& state,
                                                 double exposure_s,
                                                 std::optional<Region> region = {});

  // Hits that a laser's sheet has come near, over all pictures: what was lit, shadow ray and all.
  uint64_t laser_hits_lit() const { return laser_hits_lit_; }

 private:
  struct View {  // the first hits of one camera at one pose over the sample
    int camera = 0;
    RigidTransform sample_from_camera;
    ViewHits hits;
    size_t bytes = 0;
  };
  struct Sweep {  // of a laser at one place, seen by one camera
    int camera = 0, mount = 0;
    std::vector<double> axis_rad;
    bool blocked = false;
    std::unique_ptr<LaserSheet> sheet;
  };
  struct Picture {  // radiance at full level, W m^-2 sr^-1
    int camera = 0, lamp = 0;
    std::vector<double> axis_rad;
    std::vector<float> radiance;
  };

  Status Check(int camera, const RigState& state, double exposure_s, const Region& region) const;
  Status CheckLaser(const LaserState& laser) const;
  void AddLamps(int camera, const RigState& state, double exposure_s, const Region& region,
                std::vector<float>& electrons);
  void AddLaser(int camera, const RigState& state, double exposure_s, const Region& region,
                std::vector<float>& electrons);
  const View& ViewOf(int camera, const RigidTransform& sample_from_camera);
  View Trace(int camera, const RigidTransform& sample_from_camera) const;
  void TraceRow(const Camera& camera, const RigidTransform& sample_from_camera, int row,
                ViewHits& hits) const;
  Sweep& SweepOf(int camera, int mount, const std::vector<double>& axis_rad);
  const Picture& PictureOf(int camera, int lamp, const std::vector<double>& axis_rad);
  void MakeRoom();

  const Rig& rig_;
  const World& world_;
  const ImageOptions options_;
  std::list<View> views_;        // most recently used first
  std::list<Picture> pictures_;  // likewise
  std::list<Sweep> sweeps_;      // likewise
  uint64_t laser_hits_lit_ = 0;
};

// The channel that a pixel sees: 0 red, 1 green, 2 blue. A mono camera sees green.
int ChannelOfPixel(const Camera& camera, int i, int j);

}  // namespace mesorig::world
