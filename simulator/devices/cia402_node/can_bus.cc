#include "simulator/devices/cia402_node/can_bus.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/log.h"
#include "simulator/plant/philox.h"

namespace mesorig::simulator {
namespace {

constexpr uint32_t kPowerOnStream = 0x504F4E;  // a stream of its own

}  // namespace

CanBusDevice::CanBusDevice(const Rig& rig, uint64_t seed, Contactor& contactor) {
  for (const Axis& axis : rig.axes) {
    plant::PhiloxStream random(
        {static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)}, kPowerOnStream,
        static_cast<uint32_t>(axis.can_node), 0);
    const double turns = (random.Uniform() * 2 - 1) * 20 / 360;
    nodes_.push_back(
        std::make_unique<Cia402Node>(axis, std::round(turns * axis.counts_per_turn)));
  }
  contactor.OnChange([this](bool closed, RigTime now) {
    for (auto& node : nodes_) {
      node->SetPower(closed, now);
      for (const auto& frame : node->TakeOutput()) pending_.push_back(frame);
    }
    pending_at_ = now;
  });
}

void CanBusDevice::OnMotion(const std::function<void(size_t, bool, RigTime)>& f) {
  for (size_t axis = 0; axis < nodes_.size(); ++axis) {
    nodes_[axis]->OnMotion([f, axis](bool moves, RigTime now) { f(axis, moves, now); });
  }
}

void CanBusDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) {
  const auto frame = sim_wire::UnpackCanFrame(payload);
  if (!frame.ok()) {
    spdlog::warn("can: {}", Message(frame.status()));
    return;
  }
  SendPending(out);  // said before this frame
  for (auto& node : nodes_) {
    node->Receive(*frame, now);
    Collect(*node, now, out);
  }
}

StatusOr<std::string> CanBusDevice::Query(RigTime, std::string_view, sim_wire::Outbox&) {
  return InvalidArgument("a CAN bus answers no queries, only frames");
}

RigTime CanBusDevice::NextEvent() const {
  RigTime next = pending_at_;
  for (const auto& node : nodes_) next = std::min(next, node->NextEvent());
  return next;
}

void CanBusDevice::RunEvent(RigTime now, sim_wire::Outbox& out) {
  if (now >= pending_at_) SendPending(out);
  for (auto& node : nodes_) {
    if (node->NextEvent() > now) continue;
    node->RunEvent(now);
    Collect(*node, now, out);
  }
}

void CanBusDevice::SendPending(sim_wire::Outbox& out) {
  for (const auto& frame : pending_) out.Send(sim_wire::Pack(frame));
  pending_.clear();
  pending_at_ = kNever;
}

void CanBusDevice::Collect(Cia402Node& from, RigTime now, sim_wire::Outbox& out) {
  for (const auto& frame : from.TakeOutput()) {
    out.Send(sim_wire::Pack(frame));
    for (auto& node : nodes_) {
      if (node.get() != &from) node->Receive(frame, now);  // heartbeats among nodes
    }
  }
}

}  // namespace mesorig::simulator
