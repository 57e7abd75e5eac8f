#pragma once
// The simulator's end of the wire: owns virtual time and the one dispatcher through which every
// effect on the world goes. docs/lockstep.md.

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/unix_socket.h"

namespace mesorig::sim_wire {

// Collects what devices say at one instant, in the order of saying.
class Outbox {
 public:
  void Send(std::string payload) { payloads_.push_back(std::move(payload)); }
  std::vector<std::string> Take() { return std::exchange(payloads_, {}); }

 private:
  std::vector<std::string> payloads_;
};

// The device end of one bus or camera. Called by the dispatcher only, one call at a time, at times
// that never go back. A device's effect at an instant is seen by other devices only after it, so
// that the order of devices within an instant does not matter to physics.
class SimDevice {
 public:
  virtual ~SimDevice() = default;
  virtual std::string name() const = 0;
  virtual void Command(RigTime now, std::string_view payload, Outbox& out) = 0;
  virtual StatusOr<std::string> Query(RigTime now, std::string_view payload, Outbox& out) = 0;
  // When it will next do something by itself; kNever: only when commanded.
  virtual RigTime NextEvent() const = 0;
  // Called at exactly NextEvent(); must move NextEvent() on.
  virtual void RunEvent(RigTime now, Outbox& out) = 0;
  // A fault or an operator's hand, as text; InvalidArgument when this device does not know it.
  virtual Status Inject(RigTime now, std::string_view text, Outbox& out);
  // Its plug went out, or in again. Whoever keeps messages from an unplugged device calls this.
  virtual void Plug(RigTime now, bool plugged, Outbox& out);
};

// A fault or a hand at an instant of virtual time; `text` is DEVICE FAULT...
struct TimedInjection {
  RigTime at{};
  std::string text;
};

struct SimServerOptions {
  Welcome welcome;  // devices and now are filled in by the server
  std::chrono::milliseconds silence_limit{5000};  // of host time, then it runs on by itself
  bool pause_without_client = true;               // before the first client: time stands still
  std::vector<TimedInjection> script;             // by time; acts after the devices' own events
  // Told of each injection, by hand or from the script, after it.
  std::function<void(RigTime now, std::string_view text, const Status& status)> on_injection;
};

// Thread contract: Run on one thread; Stop from any (also a signal handler); RunExclusive from any.
class SimServer {
 public:
  // Devices are borrowed; they must outlive the server.
  SimServer(Fd listener, std::vector<SimDevice*> devices, SimServerOptions options);
  ~SimServer();
  // Serves until Stop. Returns an error only when polling itself fails.
  Status Run();
  void Stop();
  // Runs `f` as a command of the present instant: the entrance for buses with a wire of their own
  // (Modbus TCP). The caller's request must come from a rig thread that is not waiting, so that
  // time stands still meanwhile (in real time it does not).
  void RunExclusive(const std::function<void(RigTime now)>& f);
  // DEVICE FAULT..., as from the back-channel; InvalidArgument when there is no such thing.
  Status InjectNow(std::string_view text);

 private:
  struct Client;
  void Serve(Client& client, Envelope message) REQUIRES(mutex_);
  void Advance(Client& client, RigTime target) REQUIRES(mutex_);
  // Runs all events at the earliest time, at most `limit`; false when there is none.
  bool RunNextInstant(RigTime limit) REQUIRES(mutex_);
  void Collect(size_t device, Outbox& out) REQUIRES(mutex_);
  void FlushOutputs(std::string& bytes) REQUIRES(mutex_);
  // Sends what an injection caused at once: time need not move for an edge to be seen.
  void FlushToRig() REQUIRES(mutex_);
  // Why a client that would be the rig's, in lockstep or in real time, may not be.
  Status MayJoin(Role role) const REQUIRES(mutex_);
  Status Welcomed(Client& client, std::string_view hello) REQUIRES(mutex_);
  const Client* FindRole(Role role) const REQUIRES(mutex_);
  void Reply(Client& client, uint32_t id, const StatusOr<std::string>& answer) REQUIRES(mutex_);
  // "rig leap SECONDS", or DEVICE and what it shall do.
  Status Inject(std::string_view text) REQUIRES(mutex_);
  Status Leap(std::string_view seconds) REQUIRES(mutex_);
  void RunOn() REQUIRES(mutex_);
  void Accept();
  void Receive(Client& client) REQUIRES(mutex_);
  void Drop(Client& client, std::string_view why) REQUIRES(mutex_);
  int PollTimeoutMs() const REQUIRES(mutex_);

  Mutex mutex_;
  Fd listener_;
  Fd wake_read_, wake_write_;
  const std::vector<SimDevice*> devices_;
  const SimServerOptions options_;
  std::vector<std::unique_ptr<Client>> clients_;
  RigTime now_ GUARDED_BY(mutex_){};
  std::vector<Envelope> outputs_ GUARDED_BY(mutex_);
  size_t script_done_ GUARDED_BY(mutex_) = 0;
  bool had_rig_ GUARDED_BY(mutex_) = false;
  bool deterministic_ GUARDED_BY(mutex_) = true;
  bool running_on_ GUARDED_BY(mutex_) = false;
  std::chrono::steady_clock::time_point run_on_host_ GUARDED_BY(mutex_);
  RigTime run_on_now_ GUARDED_BY(mutex_){};
  std::atomic<bool> stop_{false};
};

}  // namespace mesorig::sim_wire
