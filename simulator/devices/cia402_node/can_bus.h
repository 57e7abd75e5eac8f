#pragma once
// The CAN bus of the rig as one SimDevice: every node hears every frame.

#include <functional>
#include <memory>
#include <vector>

#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/cia402_node/cia402_node.h"
#include "simulator/devices/contactor.h"

namespace mesorig::simulator {

class CanBusDevice final : public sim_wire::SimDevice {
 public:
  // One node per Rig::axes, at a power-on position that the seed chooses, within 20 degrees of home.
  CanBusDevice(const Rig& rig, uint64_t seed, Contactor& contactor);

  std::string name() const override { return std::string(sim_wire::kCanDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override;
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;

  // Told when an axis (index into Rig::axes) begins to move and when it stands again.
  void OnMotion(const std::function<void(size_t axis, bool moves, RigTime)>& f);
  const Cia402Node& node(size_t axis) const { return *nodes_[axis]; }
  size_t node_count() const { return nodes_.size(); }

 private:
  void SendPending(sim_wire::Outbox& out);
  void Collect(Cia402Node& from, RigTime now, sim_wire::Outbox& out);
  std::vector<std::unique_ptr<Cia402Node>> nodes_;
  std::vector<sim_wire::CanFrame> pending_;  // said outside a call of the dispatcher
  RigTime pending_at_ = kNever;
};

}  // namespace mesorig::simulator
