#pragma once
// What the rig's cameras see of the sample, as expected electrons: pinhole cameras with box pixels,
// point lamps with irradiance I/d^2, masking and shadows. Frames and units as in protocol/rig.
//
// First hits depend only on where a camera stands over the sample; they are kept and serve all
// lamps, exposures and light arc angles of one turntable position. A lamp's picture at full level is
// kept as well, for exposure brackets and repeats. What is not the sample (turntable, arcs) is
// black in this version. A lamp or camera that a solid hides from part of the sample's disc
// (BlockedBy) is hidden from all of it.
//
// Owned by one thread; uses `threads` of its own inside a call. Borrows rig and world.

#include <cstdint>
#include <list>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/rig/rig.h"
#include "protocol/rig/rig_geometry.h"
#include "simulator/world/transport.h"
#include "simulator/world/world.h"

namespace mesorig::world {

struct RigState {
  std::vector<double> axis_rad;     // one per Rig::axes
  std::vector<double> lamp_levels;  // one per Rig::lamps: mean over the exposure, 0..1
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

  // width*height electrons, row by row; a Bayer pixel sees its own colour. InvalidArgument for a
  // camera, number of axes or lamps that the rig has not, an angle that is not finite, a level
  // outside 0..1 or an exposure that is negative or not finite.
  StatusOr<std::vector<float>> ExpectedElectrons(int camera, const RigState& state,
                                                 double exposure_s);

 private:
  struct View {  // the first hits of one camera at one pose over the sample
    int camera = 0;
    RigidTransform sample_from_camera;
    std::vector<HitRow> rows;
    size_t bytes = 0;
  };
  struct Picture {  // radiance at full level, W m^-2 sr^-1
    int camera = 0, lamp = 0;
    std::vector<double> axis_rad;
    std::vector<float> radiance;
  };

  Status Check(int camera, const RigState& state, double exposure_s) const;
  const View& ViewOf(int camera, const RigidTransform& sample_from_camera);
  View Trace(int camera, const RigidTransform& sample_from_camera) const;
  const Picture& PictureOf(int camera, int lamp, const std::vector<double>& axis_rad);
  void MakeRoom();

  const Rig& rig_;
  const World& world_;
  const ImageOptions options_;
  std::list<View> views_;        // most recently used first
  std::list<Picture> pictures_;  // likewise
};

// The channel that a pixel sees: 0 red, 1 green, 2 blue. A mono camera sees green.
int ChannelOfPixel(const Camera& camera, int i, int j);

}  // namespace mesorig::world
