#include "simulator/bridge/usb_bridge.h"

#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"

namespace mesorig::simulator {

StatusOr<std::unique_ptr<UsbBridge>> UsbBridge::Open(sim_wire::SimLink& link, int port,
                                                     const std::string& serial) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kNxtDevice));
  std::unique_ptr<UsbBridge> bridge(new UsbBridge(link, device));
  MESORIG_ASSIGN_OR_RETURN(
      bridge->server_, UsbipServer::Open(port, serial, [bridge = bridge.get()](std::string packet) {
        const Status posted = bridge->link_.Post(bridge->device_, std::move(packet));
        if (!posted.ok()) Log("link").warn("USB: {}", Message(posted));
      }));
  link.Subscribe(device, [server = bridge->server_.get()](RigTime, std::string packet) {
    server->Deliver(std::move(packet));
  });
  return bridge;
}

UsbBridge::~UsbBridge() {
  link_.Subscribe(device_, [](RigTime, const std::string&) {});
}

}  // namespace mesorig::simulator
