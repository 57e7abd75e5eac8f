#include "simulator/bridge/rtu_framer.h"

namespace mesorig::simulator {
namespace {

constexpr size_t kChecksum = 2;
constexpr size_t kHeader = 7;  // of a request that writes several: to its byte count

// Of the request that begins the buffer; 0: more bytes are needed to know; nullopt: no known function.
std::optional<size_t> RequestSize(const std::string& buffer) {
  if (buffer.size() < 2) return 0;
  switch (static_cast<uint8_t>(buffer[1])) {
    case 0x01: case 0x02: case 0x03: case 0x04: case 0x05: case 0x06:
      return 6 + kChecksum;
    case 0x0F: case 0x10:
      if (buffer.size() < kHeader) return 0;
      return kHeader + static_cast<uint8_t>(buffer[kHeader - 1]) + kChecksum;
    default:
      return std::nullopt;
  }
}

}  // namespace

std::string WithRtuChecksum(std::string frame) {
  constexpr unsigned kPolynomial = 0xA001;
  unsigned checksum = 0xFFFF;
  for (const char byte : frame) {
    checksum ^= static_cast<uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) {
      checksum = (checksum & 1) != 0 ? checksum >> 1 ^ kPolynomial : checksum >> 1;
    }
  }
  frame += static_cast<char>(checksum & 0xFF);
  frame += static_cast<char>(checksum >> 8);
  return frame;
}

std::optional<std::string> RtuFramer::Next() {
  const auto size = RequestSize(buffer_);
  if (size && (*size == 0 || buffer_.size() < *size)) return std::nullopt;
  if (size) {
    std::string request = buffer_.substr(0, *size - kChecksum);
    if (WithRtuChecksum(request) == std::string_view(buffer_).substr(0, *size)) {
      buffer_.erase(0, *size);
      return request;
    }
  }
  ++refused_;
  buffer_.clear();
  return std::nullopt;
}

}  // namespace mesorig::simulator
