#include "daemon/bus/can_bus.h"

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

// Keeps heartbeats off the instants at which drives answer (multiples of whole milliseconds after a
// command), so that two senders do not meet in one instant (docs/lockstep.md).
constexpr RigTime kHeartbeatPhase{123'457};
constexpr uint8_t kOperational = 0x05;

}  // namespace

CanBus::CanBus(RigClock& clock, CanPort& port, CanBusOptions options)
    : clock_(clock),
      port_(port),
      options_(options),
      received_(clock),
      thread_(clock, "can", [this] { Run(); }) {
  port_.OnFrame([this](RigTime time, const CanFrame& frame) {
    received_.PushInsideChange({time, frame});
  });
}

CanBus::~CanBus() {
  port_.OnFrame([](RigTime, const CanFrame&) {});
  clock_.Change([&] { closing_ = true; });
}

void CanBus::Subscribe(uint16_t id, Handler handler) {
  clock_.Change([&] { handlers_[id] = std::move(handler); });
}

void CanBus::Unsubscribe(uint16_t id) {
  clock_.Change([&] { handlers_.erase(id); });
}

Status CanBus::SendHeartbeat() {
  return port_.Send({static_cast<uint16_t>(0x700 + options_.node_id), 1, {kOperational}});
}

void CanBus::Run() {
  RigTime heartbeat_due = clock_.Now() + kHeartbeatPhase;
  for (;;) {
    clock_.WaitUntil(heartbeat_due, [&] { return closing_ || !received_.EmptyInsideChange(); });
    bool closing = false;
    clock_.Read([&] { closing = closing_; });
    if (closing) return;
    const RigTime now = clock_.Now();
    if (now >= heartbeat_due) {
      const Status status = SendHeartbeat();
      if (!status.ok() && !heartbeat_failed_) {
        Log("bus").error("CAN: heartbeat cannot be sent: {}", Message(status));
      }
      heartbeat_failed_ = !status.ok();
      heartbeat_due = std::max(heartbeat_due + options_.heartbeat, now);
    }
    while (auto received = received_.Pop(now)) {
      clock_.Change([&] {
        const auto handler = handlers_.find(received->second.id);
        if (handler != handlers_.end()) handler->second(received->first, received->second);
      });
    }
  }
}

}  // namespace mesorig::daemon
