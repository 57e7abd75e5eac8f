#pragma once
// The daemon's side of a rig behind mesorig-sim: the link and its clock, buses, drivers, sequencer.

#include <filesystem>
#include <memory>
#include <vector>

#include "daemon/bus/sim_can_port.h"
#include "daemon/bus/sim_line_port.h"
#include "daemon/bus/sim_usb_port.h"
#include "daemon/control/manual_control.h"
#include "daemon/control/sequencer.h"
#include "daemon/drivers/driver.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon {

// Members are destroyed in the reverse order: the sequencer first, the link last. Thread contract:
// Connect and the destructor on one thread; the sequencer and health from any.
class SimulatedRig {
 public:
  // Finds the simulator in the runtime directory. `rig` is borrowed for the object's life.
  // Unimplemented when no simulator runs there; FailedPrecondition when it simulates another rig;
  // Unavailable when it does not answer.
  static StatusOr<std::unique_ptr<SimulatedRig>> Connect(const std::filesystem::path& runtime_dir,
                                                         const Rig& rig);

  Sequencer& sequencer() { return *sequencer_; }
  ManualControl& manual() { return *manual_; }
  // OK while the simulator is there.
  Status health() const { return link_->health(); }
  // The daemon ends: nothing waits any more for a rig that is gone.
  void Hurry() { link_->Hurry(); }
  // Threads that hold up rig time, and for how long in host time.
  std::vector<RigClock::Runner> Runners() const { return link_->Runners(); }

 private:
  SimulatedRig(std::unique_ptr<sim_wire::SimLink> link, const Rig& rig)
      : rig_(rig), link_(std::move(link)), stop_(*link_) {}
  Status OpenBuses();
  Status MakeDevices();

  const Rig& rig_;
  std::unique_ptr<sim_wire::SimLink> link_;
  StopFlag stop_;
  std::unique_ptr<SimCanPort> can_port_;
  std::unique_ptr<SimLinePort> line_port_;
  std::unique_ptr<SimUsbPort> usb_port_;  // in a rig with a laser
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
