#include "daemon/bus/sim_can_port.h"

#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<SimCanPort>> SimCanPort::Open(sim_wire::SimLink& link) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kCanDevice));
  return std::unique_ptr<SimCanPort>(new SimCanPort(link, device));
}

SimCanPort::~SimCanPort() {
  link_.Subscribe(device_, [](RigTime, std::string) {});
}

Status SimCanPort::Send(const CanFrame& frame) {
  return Annotate(
      link_.Post(device_, sim_wire::Pack(sim_wire::CanFrame{frame.id, frame.size, frame.data})),
      "CAN");
}

void SimCanPort::OnFrame(std::function<void(RigTime, const CanFrame&)> handler) {
  link_.Subscribe(device_, [handler = std::move(handler)](RigTime time, std::string payload) {
    const auto frame = sim_wire::UnpackCanFrame(payload);
    if (!frame.ok()) {
      Log("bus").warn("CAN: {}", Message(frame.status()));
      return;
    }
    handler(time, CanFrame{frame->id, frame->size, frame->data});
  });
}

}  // namespace mesorig::daemon
