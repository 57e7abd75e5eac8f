#pragma once
// Two bulk endpoints of one USB device, one packet a transfer: the kernel's (libusb) or the
// simulator's.

#include <functional>
#include <string>
#include <string_view>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

class UsbPort {
 public:
  virtual ~UsbPort() = default;
  // One packet to the OUT endpoint. Any thread. Unavailable when the device is gone.
  virtual Status Write(std::string_view packet) = 0;
  // `handler` gets every packet of the IN endpoint in order, under the rig clock's lock (inside
  // Change): it stores and returns. One handler.
  virtual void OnPacket(std::function<void(RigTime, std::string packet)> handler) = 0;
};

}  // namespace mesorig::daemon
