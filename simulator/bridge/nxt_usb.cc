#include "simulator/bridge/nxt_usb.h"

#include <cstdint>

namespace mesorig::simulator {
namespace {

constexpr uint16_t kVendor = 0x0694, kProduct = 0x0002;
constexpr uint8_t kSerialString = 1;
enum : uint8_t { kDevice = 1, kConfiguration = 2, kString = 3 };
// bRequest, of bmRequestType 0 (device), 1 (interface) or 2 (endpoint), 0x80: to the host.
enum : uint8_t {
  kGetStatus = 0,
  kClearFeature = 1,
  kSetAddress = 5,
  kGetDescriptor = 6,
  kGetConfiguration = 8,
  kSetConfiguration = 9,
  kGetInterface = 10,
  kSetInterface = 11,
};

std::string Bytes(std::initializer_list<int> values) {
  std::string out;
  for (const int value : values) out.push_back(static_cast<char>(value));
  return out;
}

std::string DeviceDescriptor() {
  return Bytes({18, kDevice, 0x00, 0x02, 0, 0, 0, 64, kVendor & 0xFF, kVendor >> 8, kProduct & 0xFF,
                kProduct >> 8, 0, 0, 0, 0, kSerialString, 1});
}

// One interface of the vendor's class with two bulk endpoints; powered by itself.
std::string ConfigurationDescriptor() {
  return Bytes({9, kConfiguration, 32, 0, 1, 1, 0, 0xC0, 0}) +
         Bytes({9, 4, 0, 0, 2, 0xFF, 0, 0, 0}) + Bytes({7, 5, kNxtOut, 2, kNxtPacketBytes, 0, 0}) +
         Bytes({7, 5, 0x80 | kNxtIn, 2, kNxtPacketBytes, 0, 0});
}

}  // namespace

usbip::DeviceIdentity NxtUsb::identity() const {
  usbip::DeviceIdentity identity;
  identity.vendor = kVendor, identity.product = kProduct;
  return identity;
}

std::optional<std::string> NxtUsb::Descriptor(uint8_t type, uint8_t index) const {
  if (type == kDevice && index == 0) return DeviceDescriptor();
  if (type == kConfiguration && index == 0) return ConfigurationDescriptor();
  if (type != kString || index > kSerialString) return std::nullopt;
  if (index == 0) return Bytes({4, kString, 0x09, 0x04});  // languages: US English
  std::string text = Bytes({static_cast<int>(2 + 2 * serial_.size()), kString});
  for (const char c : serial_) text += {c, '\0'};  // UTF-16, little-endian
  return text;
}

std::optional<std::string> NxtUsb::Control(std::string_view setup) {
  if (setup.size() != 8) return std::nullopt;
  const auto byte = [&](size_t at) { return static_cast<uint8_t>(setup[at]); };
  const uint8_t type = byte(0), request = byte(1);
  const size_t length = byte(6) | static_cast<size_t>(byte(7)) << 8;
  if ((type & 0x60) != 0) return std::nullopt;  // only standard requests
  if ((type & 0x80) == 0) {
    switch (request) {
      case kSetConfiguration:
        if (byte(2) > 1) return std::nullopt;
        configuration_ = byte(2);
        return "";
      case kSetInterface:
        return byte(2) == 0 && byte(4) == 0 ? std::optional<std::string>("") : std::nullopt;
      case kClearFeature:
      case kSetAddress:
        return "";
      default:
        return std::nullopt;
    }
  }
  std::optional<std::string> answer;
  if (request == kGetDescriptor) answer = Descriptor(byte(3), byte(2));
  if (request == kGetStatus) answer = Bytes({type == 0x80 ? 1 : 0, 0});  // powered by itself
  if (request == kGetConfiguration) answer = Bytes({configuration_});
  if (request == kGetInterface) answer = Bytes({0});
  if (answer) answer->resize(std::min(answer->size(), length));
  return answer;
}

}  // namespace mesorig::simulator
