#pragma once
// The daemon's end of the wire to the simulator: device traffic and, inseparable from it, the
// lockstep clock (docs/lockstep.md). When the simulator is gone the clock falls back to the
// system's pace, so that deadlines still come and every device call fails with its reason.
//
// With SimLinkOptions::live it is a wire to devices and no clock: nobody waits in it.

#include <atomic>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"
#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/unix_socket.h"

namespace mesorig::sim_wire {

struct SimLinkOptions {
  std::chrono::milliseconds alive_period{1000};
  std::chrono::milliseconds query_timeout{10000};  // host time
  // A member that runs longer than this while it holds time is named in the log and to the
  // simulator.
  std::chrono::milliseconds watchdog{2000};
  // The rig's clock where this link is not: the simulated devices then live in its real time
  // (Role::kRealTime), and what they say is handed over inside its Change, at its time. Borrowed.
  RigClock* live = nullptr;
};

// Thread-safe. Owns the socket, a reader thread and a host thread (signs of life, pacing).
class SimLink final : public RigClock {
 public:
  // `endpoint` as published by the simulator: "unix:PATH".
  static StatusOr<std::unique_ptr<SimLink>> Connect(std::string_view endpoint,
                                                    SimLinkOptions options = {});
  ~SimLink() override;

  const Welcome& welcome() const { return welcome_; }
  StatusOr<uint16_t> FindDevice(std::string_view name) const;

  // `handler` gets the device's outputs in order, under the clock's lock (inside Change): it stores
  // them and returns. Call before the first Activity; one handler a device.
  using Handler = std::function<void(RigTime, std::string payload)>;
  void Subscribe(uint16_t device, Handler handler);

  // Takes effect at the present instant: sent when time moves on, sorted by device, in order of
  // posting within one. Unavailable when the simulator is gone.
  Status Post(uint16_t device, std::string payload);
  // Answered at the present instant, after what was posted to the same device. Blocks the caller
  // without letting time pass.
  StatusOr<std::string> Query(uint16_t device, std::string payload);

  // False once the simulator ran on by itself during this connection: digests may then differ.
  bool deterministic() const { return deterministic_; }
  // Why the simulator is gone; OK while it is there.
  Status health() const;
  // The program ends: once the simulator is gone, deadlines come a thousand times as fast, so that
  // nobody waits for devices that will not answer.
  void Hurry();

 protected:
  RigTime NowLocked() const override;
  void OnChangeLocked(std::unique_lock<std::mutex>& lock) override;
  void BlockLocked(std::unique_lock<std::mutex>& lock, Entry& entry) override;
  void OnDisownLocked() override { deterministic_ = false; }

 private:
  struct Posted {
    uint16_t device;
    std::string payload;
  };
  struct PendingQuery {
    bool done = false;
    StatusOr<std::string> answer = absl::UnknownError("");
  };

  SimLink(Fd fd, Welcome welcome, SimLinkOptions options);
  void ReadLoop();
  void HostLoop();
  void Handle(Envelope message);
  void SendAdvanceLocked();
  // Moves the posted commands of `device` (all devices: nullopt) to `bytes`.
  void TakePostedLocked(std::optional<uint16_t> device, std::string& bytes);
  void Send(std::string_view bytes);
  void Break(const Status& why);

  const Fd fd_;
  const Welcome welcome_;
  const SimLinkOptions options_;
  MessageReader reader_;  // of the reader thread

  std::mutex send_mutex_;  // taken after mutex_
  // Under the clock's lock:
  RigTime now_{};
  std::chrono::steady_clock::time_point broken_at_;
  Status broken_;  // not OK: the simulator is gone
  int pace_ = 1;   // seconds a second from then on
  bool advancing_ = false;
  bool dead_end_ = false;  // no device will do anything by itself, and nobody waits for a time
  std::chrono::steady_clock::time_point pace_host_;  // when real-time pacing last moved time
  bool pace_due_ = false;
  std::vector<Posted> posted_;
  std::map<uint32_t, PendingQuery> queries_;
  uint32_t next_query_ = 1;
  std::map<uint16_t, Handler> handlers_;
  std::condition_variable query_done_, host_wake_;
  bool closing_ = false;

  std::atomic<bool> deterministic_{true};
  std::thread reader_thread_, host_thread_;
};

}  // namespace mesorig::sim_wire
