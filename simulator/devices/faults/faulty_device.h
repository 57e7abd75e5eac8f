#pragma once
// Goes around a simulated device: the faults of its messages (message_faults.h) are made here, for
// every device alike; other words of the back-channel are the device's own. Without a fault it
// changes nothing. Called by the dispatcher only.

#include <functional>
#include <memory>
#include <vector>

#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/faults/message_faults.h"

namespace mesorig::simulator {

class FaultyDevice final : public sim_wire::SimDevice {
 public:
  explicit FaultyDevice(sim_wire::SimDevice& device);  // borrowed

  std::string name() const override { return device_.name(); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  // Unavailable when the question or its answer is lost or late, or the device is unplugged.
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;

  // For a device with a wire of its own (Modbus TCP): it passes its messages here itself, and what
  // comes from it late is given to `on_late` instead of the rig's daemon.
  MessageFaults& messages() { return messages_; }
  void OnLate(std::function<void(std::string message)> f) { on_late_ = std::move(f); }

 private:
  void PassOut(RigTime now, sim_wire::Outbox& said, sim_wire::Outbox& out);
  sim_wire::SimDevice& device_;
  MessageFaults messages_;
  std::function<void(std::string)> on_late_;
  sim_wire::Outbox plug_said_;  // by the device when its plug went in or out
};

// Each device with its faults around it, in the same order. Devices are borrowed.
class FaultyDevices {
 public:
  explicit FaultyDevices(const std::vector<sim_wire::SimDevice*>& devices);
  std::vector<sim_wire::SimDevice*> All() const;
  // By the device's name; null when there is none.
  FaultyDevice* Find(std::string_view name) const;

 private:
  std::vector<std::unique_ptr<FaultyDevice>> devices_;
};

}  // namespace mesorig::simulator
