#pragma once
// Brings the rig up, and to rest.

#include "daemon/control/camera_array.h"
#include "daemon/control/rig_stance.h"
#include "daemon/control/run_context.h"

namespace mesorig::daemon {

enum class HomeWhich { kUnreferenced, kAll };

// Of one run, on the sequencer's thread. Borrows everything.
class RigPower {
 public:
  RigPower(const RunContext& context, RigStance& stance, CameraArray& cameras)
      : context_(context), stance_(stance), cameras_(cameras) {}

  // Opens every device, also one that was gone, switches torque on and homes. FailedPrecondition
  // when the chain is open; else the device's error.
  Status Up(HomeWhich homing);
  // Torque off (before hands come near, or at the end); lamps and laser off.
  Status Down();
  // Whatever happened: lamps and laser off, axes quick-stopped, then torque off. Goes on after each
  // failure, tries again what failed, and notes it. Not OK: something may still be on.
  Status MakeSafe();
  // All axes at home, then torque off. The chain is closed.
  Status Park();
  Status AxesOn(HomeWhich homing);

 private:
  Status Home(HomeWhich which);

  const RunContext& context_;
  RigStance& stance_;
  CameraArray& cameras_;
};

}  // namespace mesorig::daemon
