#pragma once
// The daemon's side of a rig: its buses, drivers, safety and sequencer, and the hand of an operator.

#include <filesystem>
#include <memory>
#include <vector>

#include "daemon/app/rig_buses.h"
#include "daemon/control/manual_control.h"
#include "daemon/control/sequencer.h"
#include "daemon/drivers/driver.h"

namespace mesorig::daemon {

// Members are destroyed in the reverse order: the sequencer first, the buses last. Thread contract:
// Connect and the destructor on one thread; the sequencer and health from any.
class AttachedRig {
 public:
  // `rig` is borrowed for the object's life. Errors of RigBuses and ModbusBus.
  static StatusOr<std::unique_ptr<AttachedRig>> Connect(const std::filesystem::path& runtime_dir,
                                                         const Rig& rig);

  Sequencer& sequencer() { return *sequencer_; }
  ManualControl& manual() { return *manual_; }
  // OK while the rig can be spoken with (RigBuses).
  Status health() const { return buses_->health(); }
  // The daemon ends: nothing waits any more for a rig that is gone.
  void Hurry() { buses_->Hurry(); }
  // Threads that hold up rig time, and for how long in host time.
  std::vector<RigClock::Runner> Runners() const { return clock_.Runners(); }

 private:
  AttachedRig(std::unique_ptr<RigBuses> buses, const Rig& rig)
      : rig_(rig), buses_(std::move(buses)), clock_(buses_->clock()), stop_(clock_) {}
  Status StartBuses();
  Status MakeDevices();
  ManualDevices ByHand();

  const Rig& rig_;
  const std::unique_ptr<RigBuses> buses_;
  RigClock& clock_;
  StopFlag stop_;
  std::unique_ptr<CanBus> can_;
  std::unique_ptr<ModbusBus> modbus_;
  std::vector<std::unique_ptr<Axis>> axes_;
  std::unique_ptr<LampBank> lamps_;
  std::unique_ptr<DigitalLines> lines_;
  std::unique_ptr<LineLaser> laser_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::unique_ptr<Sequencer> sequencer_;
  std::unique_ptr<ManualControl> manual_;
};

}  // namespace mesorig::daemon
