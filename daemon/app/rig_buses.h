#pragma once
// What a rig's devices hang on: its clock, and a port for each bus. A bus that the rig file names
// ([buses], rigs/README.md) is the kernel's; what it does not name is the simulator's. A rig that
// names none lives in the simulator's virtual time (docs/lockstep.md); any other one in the system's,
// with what is still simulated beside it in real time. The one place that chooses.

#include <filesystem>
#include <memory>
#include <vector>

#include "daemon/bus/can_port.h"
#include "daemon/bus/line_port.h"
#include "daemon/bus/modbus_bus.h"
#include "daemon/bus/usb_port.h"
#include "protocol/rig/rig.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::daemon {

// Thread contract: Open and the destructor on one thread, the rest from any. Ports are the object's.
class RigBuses {
 public:
  // Unimplemented when what has only a simulated end finds no simulator in the runtime directory;
  // FailedPrecondition when it simulates another rig, or another process has an interface (the
  // message names both); NotFound for an interface that is not there; Unavailable when somebody does
  // not answer. `rig` is borrowed.
  static StatusOr<std::unique_ptr<RigBuses>> Open(const std::filesystem::path& runtime_dir,
                                                  const Rig& rig);

  RigClock& clock() { return *clock_; }
  CanPort& can() { return *can_; }
  LinePort& lines() { return *lines_; }
  UsbPort* usb() { return usb_.get(); }  // null in a rig without a laser
  StatusOr<std::unique_ptr<ModbusBus>> ConnectModbus(const ModbusBusOptions& options);
  sim_wire::SimLink* simulator() { return link_.get(); }  // cameras

  // OK while the simulator is there. (A kernel's interface that goes away may come back: its devices
  // tell.)
  Status health() const { return link_->health(); }
  // Equal seeds give equal bytes: only in the simulator's own time.
  bool deterministic() const { return !real_ && link_->deterministic(); }
  // The daemon ends: nothing waits any more for a rig that is gone.
  void Hurry() { link_->Hurry(); }

 private:
  explicit RigBuses(const Rig& rig) : rig_(rig), real_(rig.buses.any()) {}
  Status FindSimulator(const std::filesystem::path& runtime_dir);
  Status OpenCan();
  Status OpenLines();
  Status OpenUsb();

  const Rig& rig_;
  const bool real_;
  SystemRigClock system_clock_;  // of a rig on real buses
  std::unique_ptr<sim_wire::SimLink> link_;
  RigClock* clock_ = nullptr;
  std::unique_ptr<CanPort> can_;
  std::unique_ptr<LinePort> lines_;
  std::unique_ptr<UsbPort> usb_;
};

}  // namespace mesorig::daemon
