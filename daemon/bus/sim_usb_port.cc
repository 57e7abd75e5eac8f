#include "daemon/bus/sim_usb_port.h"

#include "protocol/sim_wire/payloads.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<SimUsbPort>> SimUsbPort::Open(sim_wire::SimLink& link) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kNxtDevice));
  return std::unique_ptr<SimUsbPort>(new SimUsbPort(link, device));
}

SimUsbPort::~SimUsbPort() {
  link_.Subscribe(device_, [](RigTime, std::string) {});
}

Status SimUsbPort::Write(std::string_view packet) {
  return link_.Post(device_, std::string(packet));
}

void SimUsbPort::OnPacket(std::function<void(RigTime, std::string packet)> handler) {
  link_.Subscribe(device_, std::move(handler));
}

}  // namespace mesorig::daemon
