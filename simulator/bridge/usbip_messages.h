#pragma once
// Messages of USB/IP, version 1.1.1 (Linux, Documentation/usb/usbip_protocol.rst), as a server of
// one device needs them. Numbers are big-endian. Nothing here touches a socket.

#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig::simulator::usbip {

inline constexpr uint16_t kVersion = 0x0111;
inline constexpr size_t kRequestBytes = 8;  // a header before the device is attached
inline constexpr size_t kBusIdBytes = 32;   // follows an import
inline constexpr size_t kUrbHeaderBytes = 48;
inline constexpr int32_t kMostUrbBytes = 1 << 16;  // of data, of one URB

// Before the device is attached.
enum class Request : uint16_t { kDeviceList = 0x8005, kImport = 0x8003 };
// InvalidArgument: another version, another request, or not 8 bytes.
StatusOr<Request> ParseRequest(std::string_view bytes);

struct DeviceIdentity {
  std::string bus_id = "1-1";
  uint16_t vendor = 0, product = 0, release = 0;  // release: bcdDevice
  uint8_t interface_class = 0xFF;
};
std::string DeviceListReply(const DeviceIdentity& device);
// To a request of a device that is not `device`, or is taken: refused.
std::string ImportReply(const DeviceIdentity& device, bool granted);

// Once it is attached.
struct Urb {
  bool unlink = false;
  uint32_t number = 0;
  bool in = false;
  uint32_t endpoint = 0;
  int32_t size = 0;       // of the data, which follows when !in
  uint32_t unlinked = 0;  // unlink: whose number
  std::string setup;      // 8 bytes, of endpoint 0
};
// InvalidArgument: not 48 bytes, another command, or a size out of [0, kMostUrbBytes].
StatusOr<Urb> ParseUrb(std::string_view header);
// `status`: 0 or a negative errno. `data` of an IN; `sent`: bytes that an OUT took.
std::string UrbReply(const Urb& urb, int32_t status, std::string_view data, size_t sent = 0);
std::string UnlinkReply(const Urb& urb, bool was_waiting);

}  // namespace mesorig::simulator::usbip
