#pragma once
// A classic CAN interface, 11-bit identifiers: the kernel's or the simulator's.

#include <array>
#include <cstdint>
#include <functional>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct CanFrame {
  uint16_t id = 0;   // 0..0x7FF
  uint8_t size = 0;  // 0..8
  std::array<uint8_t, 8> data{};
  friend bool operator==(const CanFrame&, const CanFrame&) = default;
};

class CanPort {
 public:
  virtual ~CanPort() = default;
  // Any thread. Unavailable when the bus or the simulator is gone.
  virtual Status Send(const CanFrame& frame) = 0;
  // `handler` gets every received frame in order, under the rig clock's lock (inside Change): it
  // stores and returns. One handler, set before the clock's first activity.
  virtual void OnFrame(std::function<void(RigTime, const CanFrame&)> handler) = 0;
};

}  // namespace mesorig::daemon
