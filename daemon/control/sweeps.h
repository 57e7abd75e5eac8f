#pragma once
// Sweeps of the laser (docs/laser.md).

#include <vector>

#include "daemon/control/camera_array.h"
#include "daemon/control/rig_stance.h"
#include "daemon/control/run_context.h"
#include "daemon/control/shot_book.h"

namespace mesorig::daemon {

// Of one run, on the sequencer's thread. Borrows everything.
class Sweeps {
 public:
  Sweeps(const RunContext& context, RigStance& stance, CameraArray& cameras, ShotBook& book)
      : context_(context), stance_(stance), cameras_(cameras), book_(book) {}

  // Takes what the step owes, with the rig in this stance: the emitter travels to its run-up while
  // the axes move. A frame that an earlier way of the emitter left owing is taken on the next one,
  // at most three. Unavailable: some are missing still; else the device's error. The laser is off
  // when this returns.
  Status Take(const Step& step, const Stance& stance);

 private:
  // Per frame the cameras whose picture is still missing.
  using Owed = std::vector<std::vector<int>>;
  Status Once(const Step& step, const Stance& stance, Owed& owed, Status& missing);
  Status ShootFrames(const Step& step, double rate_rad_s, Owed& owed, Status& missing);
  // The laser shines, and the axes stand where they should.
  Status CheckSheet(const Step& step, uint32_t index);
  Status ShootFrame(const Step& step, uint32_t index, RigTime deadline, std::vector<int>& cameras,
                    Status& missing);

  const RunContext& context_;
  RigStance& stance_;
  CameraArray& cameras_;
  ShotBook& book_;
};

}  // namespace mesorig::daemon
