#include "simulator/devices/cia402_node/can_bus.h"

#include <algorithm>
#include <cmath>

#include "protocol/base/log.h"
#include "simulator/devices/faults/fault_table.h"
#include "simulator/plant/philox.h"

namespace mesorig::simulator {
namespace {

constexpr uint32_t kPowerOnStream = 0x504F4E;  // a stream of its own

}  // namespace

CanBusDevice::CanBusDevice(const Rig& rig, uint64_t seed, Contactor& contactor) : axes_(rig.axes) {
  for (const Axis& axis : rig.axes) {
    plant::PhiloxStream random({static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)},
                               kPowerOnStream, static_cast<uint32_t>(axis.can_node), 0);
    const double turns = (random.Uniform() * 2 - 1) * 20 / 360;
    nodes_.push_back(std::make_unique<Cia402Node>(axis, std::round(turns * axis.counts_per_turn)));
    faults_.push_back(std::make_unique<MessageFaults>());
    faults_.back()->OnPlug(
        [node = nodes_.back().get()](bool plugged, RigTime now) { node->SetSupply(plugged, now); });
  }
  contactor.OnChange([this](bool closed, RigTime now) {
    for (size_t axis = 0; axis < nodes_.size(); ++axis) {
      nodes_[axis]->SetPower(closed, now);
      Collect(axis, now, pending_);
    }
    pending_at_ = now;
  });
}

void CanBusDevice::OnMotion(const std::function<void(size_t, bool, RigTime)>& f) {
  for (size_t axis = 0; axis < nodes_.size(); ++axis) {
    nodes_[axis]->OnMotion([f, axis](bool moves, RigTime now) { f(axis, moves, now); });
  }
}

void CanBusDevice::OnTorque(const std::function<void(size_t, bool, RigTime)>& f) {
  for (size_t axis = 0; axis < nodes_.size(); ++axis) {
    nodes_[axis]->OnTorque([f, axis](bool on, RigTime now) { f(axis, on, now); });
  }
}

void CanBusDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) {
  const auto frame = sim_wire::UnpackCanFrame(payload);
  if (!frame.ok()) {
    spdlog::warn("can: {}", Message(frame.status()));
    return;
  }
  SendPending(out);  // said before this frame
  for (size_t axis = 0; axis < nodes_.size(); ++axis) {
    Hear(axis, *frame, now);
    Collect(axis, now, out);
  }
}

StatusOr<std::string> CanBusDevice::Query(RigTime, std::string_view, sim_wire::Outbox&) {
  return InvalidArgument("a CAN bus answers no queries, only frames");
}

RigTime CanBusDevice::NextEvent() const {
  RigTime next = pending_at_;
  for (const auto& node : nodes_) next = std::min(next, node->NextEvent());
  for (const auto& faults : faults_) next = std::min(next, faults->NextEvent());
  return next;
}

void CanBusDevice::RunEvent(RigTime now, sim_wire::Outbox& out) {
  if (now >= pending_at_) SendPending(out);
  for (size_t axis = 0; axis < nodes_.size(); ++axis) {
    if (faults_[axis]->NextEvent() <= now) {
      for (const MessageFaults::Late& late : faults_[axis]->RunEvent(now)) {
        const auto frame = sim_wire::UnpackCanFrame(late.message);
        if (late.way == MessageFaults::Way::kOut) {
          Say(axis, late.message, now, out);
        } else if (frame.ok()) {
          nodes_[axis]->Receive(*frame, now);
        }
      }
      Collect(axis, now, out);
    }
    if (nodes_[axis]->NextEvent() > now) continue;
    nodes_[axis]->RunEvent(now);
    Collect(axis, now, out);
  }
}

void CanBusDevice::SendPending(sim_wire::Outbox& out) {
  for (std::string& frame : pending_.Take()) out.Send(std::move(frame));
  pending_at_ = kNever;
}

void CanBusDevice::Hear(size_t axis, const sim_wire::CanFrame& frame, RigTime now) {
  const bool to_it = (frame.id & 0x7F) == nodes_[axis]->node() || frame.id == 0 || frame.id > 0x700;
  if (!to_it) return;  // a node looks at nothing else
  for (const std::string& passed :
       faults_[axis]->Pass(MessageFaults::Way::kIn, now, sim_wire::Pack(frame))) {
    const auto heard = sim_wire::UnpackCanFrame(passed);
    if (heard.ok()) nodes_[axis]->Receive(*heard, now);
  }
}

void CanBusDevice::Collect(size_t axis, RigTime now, sim_wire::Outbox& out) {
  for (const auto& frame : nodes_[axis]->TakeOutput()) {
    for (const std::string& passed :
         faults_[axis]->Pass(MessageFaults::Way::kOut, now, sim_wire::Pack(frame))) {
      Say(axis, passed, now, out);
    }
  }
}

void CanBusDevice::Say(size_t axis, const std::string& packed, RigTime now, sim_wire::Outbox& out) {
  out.Send(packed);
  const auto frame = sim_wire::UnpackCanFrame(packed);
  for (size_t other = 0; other < nodes_.size() && frame.ok(); ++other) {
    if (other != axis) Hear(other, *frame, now);  // heartbeats among nodes
  }
}

Status CanBusDevice::Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) {
  const std::string_view name = text.substr(0, text.find(' '));
  std::string names;
  for (size_t axis = 0; axis < axes_.size(); ++axis) {
    names += (axis == 0 ? "" : ", ") + axes_[axis].name;
    if (axes_[axis].name != name) continue;
    const Status status =
        InjectAxis(axis, now, text.substr(std::min(name.size() + 1, text.size())));
    Collect(axis, now, out);
    return Annotate(status, fmt::format("can {}", name));
  }
  return InvalidArgument("can: no axis \"{}\"; there are {}", name, names);
}

Status CanBusDevice::InjectAxis(size_t axis, RigTime now, std::string_view text) {
  if (const auto injected = faults_[axis]->Inject(now, text)) return *injected;
  const auto words = FaultWords(text);
  if (text == "stuck" || text == "free") {
    nodes_[axis]->SetStuck(text == "stuck", now);
    return OkStatus();
  }
  if (text == "hot" || text == "cool") {
    nodes_[axis]->SetHot(text == "hot", now);
    return OkStatus();
  }
  if (words.size() == 2 && (words[0] == "lose" || words[0] == "slip")) {
    double degrees = 0;
    MESORIG_RETURN_IF_ERROR(FaultReal(words, 1, -360, 360, degrees));
    const double counts = degrees / 360 * axes_[axis].counts_per_turn;
    if (words[0] == "lose") {
      nodes_[axis]->LoseSteps(counts, now);
    } else {
      nodes_[axis]->SlipEncoder(counts);
    }
    return OkStatus();
  }
  return InvalidArgument(
      "\"{}\" is no fault of an axis: stuck, free, lose DEG, slip DEG, hot, cool", text);
}

}  // namespace mesorig::simulator
