#pragma once
// Requests of Modbus RTU out of the bytes of a serial line (Modbus over serial line V1.02, 2.5.1).

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace mesorig::simulator {

// `frame` with its checksum behind it (V1.02, 6.2.2).
std::string WithRtuChecksum(std::string frame);

// Of one thread. Any bytes are permitted.
class RtuFramer {
 public:
  void Feed(std::string_view bytes) { buffer_ += bytes; }
  // The next whole request whose checksum is right: unit, function, data; without the checksum. One
  // that is wrong, or of a function whose length is not known here, takes with it what came with it:
  // a request begins after silence.
  std::optional<std::string> Next();
  // The line was silent: what came in half is no request.
  void Silence() { buffer_.clear(); }
  bool empty() const { return buffer_.empty(); }
  uint64_t refused() const { return refused_; }

 private:
  std::string buffer_;
  uint64_t refused_ = 0;
};

}  // namespace mesorig::simulator
