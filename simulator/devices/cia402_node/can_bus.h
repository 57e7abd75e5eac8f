#pragma once
// The CAN bus of the rig as one SimDevice: every node hears every frame. By the back-channel `can
// AXIS FAULT`: the messages of one node (simulator/devices/faults/message_faults.h, counted are
// those of its own identifiers, NMT and heartbeats), `stuck`, `free`, `lose DEG`,
// `slip DEG`, `hot` and `cool`. A node that is
// disconnected is without supply as well, and boots when it is plugged in again.

#include <functional>
#include <memory>
#include <vector>

#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/cia402_node/cia402_node.h"
#include "simulator/devices/contactor.h"
#include "simulator/devices/faults/message_faults.h"

namespace mesorig::simulator {

class CanBusDevice final : public sim_wire::SimDevice {
 public:
  // One node per Rig::axes, at a power-on position that the seed chooses, within 20 degrees of
  // home.
  CanBusDevice(const Rig& rig, uint64_t seed, Contactor& contactor);

  std::string name() const override { return std::string(sim_wire::kCanDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;

  // Told when an axis (index into Rig::axes) begins to move and when it stands again.
  void OnMotion(const std::function<void(size_t axis, bool moves, RigTime)>& f);
  // Likewise when its motor gets torque and when it has none any more.
  void OnTorque(const std::function<void(size_t axis, bool on, RigTime)>& f);
  const Cia402Node& node(size_t axis) const { return *nodes_[axis]; }
  size_t node_count() const { return nodes_.size(); }

 private:
  void SendPending(sim_wire::Outbox& out);
  // A frame on its way to a node, from a node to the bus, and on the bus.
  void Hear(size_t axis, const sim_wire::CanFrame& frame, RigTime now);
  void Collect(size_t axis, RigTime now, sim_wire::Outbox& out);
  void Say(size_t axis, const std::string& packed, RigTime now, sim_wire::Outbox& out);
  Status InjectAxis(size_t axis, RigTime now, std::string_view text);

  std::vector<Axis> axes_;
  std::vector<std::unique_ptr<Cia402Node>> nodes_;
  std::vector<std::unique_ptr<MessageFaults>> faults_;  // per node
  sim_wire::Outbox pending_;                            // said outside a call of the dispatcher
  RigTime pending_at_ = kNever;
};

}  // namespace mesorig::simulator
