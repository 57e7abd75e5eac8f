#pragma once
// Owner of one CAN bus: a rig thread that hands received frames to their subscribers and produces
// the daemon's CANopen heartbeat (CiA 301, 7.2.8.3.2), which the drives' heartbeat consumers
// (0x1016) watch: a daemon that dies stops the axes.

#include <functional>
#include <map>

#include "daemon/bus/can_port.h"
#include "daemon/device/rig_thread.h"

namespace mesorig::daemon {

struct CanBusOptions {
  uint8_t node_id = 127;           // the daemon's own; its heartbeat is 0x700 + node_id
  RigTime heartbeat{500'000'000};  // period in rig time
};

// Thread-safe. Borrows clock and port, which outlive it.
class CanBus {
 public:
  using Handler = std::function<void(RigTime, const CanFrame&)>;

  CanBus(RigClock& clock, CanPort& port, CanBusOptions options);
  ~CanBus();

  // Frames of one instant reach the bus in order of sending: one rig thread drives one node.
  Status Send(const CanFrame& frame) { return port_.Send(frame); }
  // The daemon's heartbeat, between those that the bus sends by itself: a consumer watches only from
  // the first one on that it hears.
  Status SendHeartbeat();
  // `handler` is called under the clock's lock (inside Change): it stores and returns. One handler
  // an identifier; it stays until Unsubscribe.
  void Subscribe(uint16_t id, Handler handler);
  void Unsubscribe(uint16_t id);

  const CanBusOptions& options() const { return options_; }

 private:
  void Run();

  RigClock& clock_;
  CanPort& port_;
  const CanBusOptions options_;
  // Guarded by the clock's lock:
  std::map<uint16_t, Handler> handlers_;
  bool closing_ = false;
  RigQueue<std::pair<RigTime, CanFrame>> received_;
  bool heartbeat_failed_ = false;  // of the bus thread
  RigThread thread_;
};

}  // namespace mesorig::daemon
