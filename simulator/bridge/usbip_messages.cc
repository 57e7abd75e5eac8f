#include "simulator/bridge/usbip_messages.h"

#include <cerrno>

namespace mesorig::simulator::usbip {
namespace {

enum : uint32_t { kSubmit = 1, kUnlink = 2, kSubmitted = 3, kUnlinked = 4 };
constexpr uint16_t kDeviceListReply = 0x0005, kImportReply = 0x0003;
constexpr size_t kPathBytes = 256;
constexpr uint32_t kFullSpeed = 2, kBus = 1, kAddress = 2;

uint32_t Get32(std::string_view bytes, size_t at) {
  uint32_t value = 0;
  for (size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<uint8_t>(bytes[at + k]);
  return value;
}

void Put32(std::string& out, uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<char>(value >> shift));
}

void Put16(std::string& out, uint16_t value) {
  out.push_back(static_cast<char>(value >> 8));
  out.push_back(static_cast<char>(value));
}

void PutPadded(std::string& out, std::string_view text, size_t size) {
  text = text.substr(0, size - 1);
  out.append(text).append(size - text.size(), '\0');
}

std::string ReplyHeader(uint16_t code, uint32_t status) {
  std::string out;
  Put16(out, kVersion), Put16(out, code), Put32(out, status);
  return out;
}

void PutDevice(std::string& out, const DeviceIdentity& device) {
  PutPadded(out, "/sys/devices/mesorig-sim/" + device.bus_id, kPathBytes);
  PutPadded(out, device.bus_id, kBusIdBytes);
  Put32(out, kBus), Put32(out, kAddress), Put32(out, kFullSpeed);
  Put16(out, device.vendor), Put16(out, device.product), Put16(out, device.release);
  // Class, subclass and protocol are the interface's; configuration 1 of 1, with 1 interface.
  for (const int byte : {0, 0, 0, 1, 1, 1}) out.push_back(static_cast<char>(byte));
}

// What RET_SUBMIT and RET_UNLINK begin with; device, direction and endpoint are 0 in replies.
std::string UrbReplyHeader(uint32_t command, uint32_t number, int32_t status) {
  std::string out;
  Put32(out, command), Put32(out, number);
  out.append(12, '\0');
  Put32(out, static_cast<uint32_t>(status));
  return out;
}

}  // namespace

StatusOr<Request> ParseRequest(std::string_view bytes) {
  if (bytes.size() != kRequestBytes)
    return InvalidArgument("USB/IP: a request of {} bytes", bytes.size());
  const uint32_t head = Get32(bytes, 0);
  if (head >> 16 != kVersion) {
    return InvalidArgument("USB/IP: version 0x{:04X}, this is 0x{:04X}", head >> 16, kVersion);
  }
  const auto code = static_cast<Request>(head & 0xFFFF);
  if (code == Request::kDeviceList || code == Request::kImport) return code;
  return InvalidArgument("USB/IP: request 0x{:04X}", head & 0xFFFF);
}

std::string DeviceListReply(const DeviceIdentity& device) {
  std::string out = ReplyHeader(kDeviceListReply, 0);
  Put32(out, 1);
  PutDevice(out, device);
  out.push_back(static_cast<char>(device.interface_class));
  out.append(3, '\0');
  return out;
}

std::string ImportReply(const DeviceIdentity& device, bool granted) {
  std::string out = ReplyHeader(kImportReply, granted ? 0 : 1);
  if (granted) PutDevice(out, device);
  return out;
}

StatusOr<Urb> ParseUrb(std::string_view header) {
  if (header.size() != kUrbHeaderBytes)
    return InvalidArgument("USB/IP: a URB of {} bytes", header.size());
  const uint32_t command = Get32(header, 0);
  Urb urb;
  urb.number = Get32(header, 4);
  urb.in = Get32(header, 12) != 0;
  urb.endpoint = Get32(header, 16);
  if (command == kUnlink) {
    urb.unlink = true;
    urb.unlinked = Get32(header, 20);
    return urb;
  }
  if (command != kSubmit) return InvalidArgument("USB/IP: command {}", command);
  urb.size = static_cast<int32_t>(Get32(header, 24));
  if (urb.size < 0 || urb.size > kMostUrbBytes) {
    return InvalidArgument("USB/IP: a URB of {} bytes of data, 0 to {} are taken", urb.size,
                           kMostUrbBytes);
  }
  urb.setup = header.substr(40, 8);
  return urb;
}

std::string UrbReply(const Urb& urb, int32_t status, std::string_view data, size_t sent) {
  std::string out = UrbReplyHeader(kSubmitted, urb.number, status);
  Put32(out, static_cast<uint32_t>(urb.in ? data.size() : sent));
  out.append(kUrbHeaderBytes - out.size(), '\0');
  if (urb.in) out.append(data);
  return out;
}

std::string UnlinkReply(const Urb& urb, bool was_waiting) {
  std::string out = UrbReplyHeader(kUnlinked, urb.number, was_waiting ? -ECONNRESET : 0);
  out.append(kUrbHeaderBytes - out.size(), '\0');
  return out;
}

}  // namespace mesorig::simulator::usbip
