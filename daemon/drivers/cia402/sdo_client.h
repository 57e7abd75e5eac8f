#pragma once
// Expedited SDO transfers with one node (CiA 301, 7.2.4): a request on 0x600 + node, its answer on
// 0x580 + node.

#include <optional>
#include <string>

#include "daemon/bus/can_bus.h"
#include "daemon/device/stop_flag.h"
#include "daemon/drivers/cia402/objects.h"

namespace mesorig::daemon::cia402 {

enum class Heed { kStop, kNothing };  // whether a wait ends when the StopFlag is up

// What came wrong. A transfer can be asked for twice without harm, so that one lost telegram is none.
struct SdoCounts {
  uint64_t unanswered = 0;  // requests without an answer in half the timeout
  uint64_t foreign = 0;     // answers to an earlier request, or damaged: passed over
  uint64_t aborted = 0;     // by the node
};

// Of one rig thread. Borrows clock, bus and flag.
// Errors: DeadlineExceeded: no answer to two requests within the timeout; Unavailable: the node aborted (the code in words) or the bus
// is gone; Cancelled: stopped.
class SdoClient {
 public:
  // `device` begins every message: "axis turntable (node 1)".
  SdoClient(RigClock& clock, CanBus& bus, const StopFlag& stop, int node, std::string device,
            RigTime timeout);
  ~SdoClient();

  Status Write(const Object& object, uint32_t value, Heed heed = Heed::kStop);
  StatusOr<uint32_t> Read(const Object& object, Heed heed = Heed::kStop);
  SdoCounts counts() const;

 private:
  StatusOr<CanFrame> Exchange(const Object& object, CanFrame request, Heed heed,
                              std::string_view operation);

  RigClock& clock_;
  CanBus& bus_;
  const StopFlag& stop_;
  const int node_;
  const std::string device_;
  const RigTime timeout_;
  // Guarded by the clock's lock:
  uint32_t expected_ = 0;  // index << 8 | sub of the request under way
  std::optional<CanFrame> answer_;
  SdoCounts counts_;
};

// Little-endian numbers inside a frame.
inline uint32_t GetLittle(const CanFrame& frame, int at, int bytes) {
  uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= uint32_t{frame.data[at + i]} << (8 * i);
  return value;
}
inline void PutLittle(CanFrame& frame, int at, int bytes, uint32_t value) {
  for (int i = 0; i < bytes; ++i) frame.data[at + i] = static_cast<uint8_t>(value >> (8 * i));
}

}  // namespace mesorig::daemon::cia402
