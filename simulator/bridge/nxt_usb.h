#pragma once
// What an NXT brick is on a USB cable: its descriptors (USB 2.0, chapter 9) and requests of
// endpoint 0. LEGO MINDSTORMS NXT Hardware Developer Kit: vendor 0694, product 0002, bulk OUT 0x01
// and IN 0x82 of 64 bytes, its serial number is its Bluetooth address.

#include <optional>
#include <string>
#include <string_view>

#include "simulator/bridge/usbip_messages.h"

namespace mesorig::simulator {

inline constexpr size_t kNxtPacketBytes = 64;
inline constexpr uint32_t kNxtOut = 1, kNxtIn = 2;

class NxtUsb {
 public:
  explicit NxtUsb(std::string serial) : serial_(std::move(serial)) {}
  usbip::DeviceIdentity identity() const;
  // The answer of endpoint 0 to a setup packet of 8 bytes, cut to the length that it asks for;
  // empty for what asks for none; nullopt: the request stalls.
  std::optional<std::string> Control(std::string_view setup);

 private:
  std::optional<std::string> Descriptor(uint8_t type, uint8_t index) const;

  const std::string serial_;
  uint8_t configuration_ = 0;
};

}  // namespace mesorig::simulator
