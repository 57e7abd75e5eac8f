#pragma once
// A CAN bus whose other end is a function.

#include <mutex>
#include <vector>

#include "daemon/bus/can_port.h"

namespace mesorig::daemon {

class FakeCanPort final : public CanPort {
 public:
  using Peer = std::function<std::vector<CanFrame>(const CanFrame&)>;
  FakeCanPort(RigClock& clock, Peer peer) : clock_(clock), peer_(std::move(peer)) {}
  Status Send(const CanFrame& frame) override {
    std::vector<CanFrame> replies;
    {
      std::lock_guard lock(mutex_);
      sent_.push_back(frame);
      if (peer_) replies = peer_(frame);
    }
    for (const CanFrame& reply : replies) Deliver(reply);
    return OkStatus();
  }
  void OnFrame(std::function<void(RigTime, const CanFrame&)> handler) override {
    clock_.Change([&] { handler_ = std::move(handler); });
  }
  void Deliver(const CanFrame& frame) {
    const RigTime now = clock_.Now();
    clock_.Change([&] {
      if (handler_) handler_(now, frame);
    });
  }
  std::vector<CanFrame> sent() const {
    std::lock_guard lock(mutex_);
    return sent_;
  }

 private:
  RigClock& clock_;
  const Peer peer_;
  std::function<void(RigTime, const CanFrame&)> handler_;
  mutable std::mutex mutex_;
  std::vector<CanFrame> sent_;
};

}  // namespace mesorig::daemon
