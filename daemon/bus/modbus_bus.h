#pragma once
// Owner of one Modbus connection (libmodbus, Modbus application protocol V1.1b3 over TCP, or RTU over
// a serial line, V1.02): a rig thread with a queue of jobs. libmodbus blocks; the thread runs meanwhile, so that virtual time
// stands still (docs/lockstep.md). While its owner works, the bus sends a keep-alive read so that
// the slave's communication-loss timeout does not fire during long moves; when the owner has asked
// for nothing for `keep_alive_limit`, or a write has failed, it stops, and the slave's timeout
// acts.

#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/device/rig_thread.h"
#include "protocol/base/status.h"
#include "protocol/base/unique_fd.h"
#include "protocol/rig/buses.h"

struct _modbus;

namespace mesorig::daemon {

struct ModbusBusOptions {
  int unit = 1;
  RigTime keep_alive = kNever;  // period; kNever: none
  RigTime keep_alive_limit = std::chrono::minutes(2);
  std::chrono::milliseconds response_timeout{1000};  // host time
};

// What came wrong since Connect, by kind of answer.
struct ModbusCounts {
  uint64_t unanswered = 0;  // no answer within the response timeout; one that comes later is lost
  // Not an answer to the request that was sent (other number, function, size), or its CRC is wrong.
  uint64_t damaged = 0;
  uint64_t refused = 0;      // the slave's exceptions
  uint64_t broken = 0;       // connections closed or refused by the other side, lines hung up
  uint64_t connections = 0;  // made anew
  uint64_t unheeded = 0;     // writes that were confirmed and read back otherwise
};

// Every error closes the connection, so that a late answer is not taken for the next one's; the
// request is sent once more on a new one. What is written is read back. (On a serial line answers have
// no number: what waits there when it is opened again is thrown away, and what comes later than that
// shows by its function and size, and coils by being read back.) A line that was hung up, or whose
// adapter was unplugged, is opened again with the next request.
// Thread-safe. Reads and writes are for rig threads (they wait in the rig clock); WriteCoilsAtOnce
// is for any thread. Errors: Unavailable names the endpoint, the request and libmodbus' reason.
class ModbusBus {
 public:
  // `endpoint` is "HOST:PORT" with a numeric host. Connects; Unavailable when nobody listens.
  static StatusOr<std::unique_ptr<ModbusBus>> Connect(RigClock& clock, std::string_view endpoint,
                                                      ModbusBusOptions options);
  // The same, over a serial line or TCP as a rig file says, for this process alone: FailedPrecondition
  // names the process that has it.
  static StatusOr<std::unique_ptr<ModbusBus>> Open(RigClock& clock, const Buses::Modbus& where,
                                                   ModbusBusOptions options);
  ~ModbusBus();

  // One request: all coils change together.
  Status WriteCoils(int first, std::vector<uint8_t> values);
  StatusOr<std::vector<uint16_t>> ReadInputRegisters(int first, int count);
  // The same for somebody who only looks: it does not count as the owner's work, and is Unavailable
  // while the slave, with a coil that may be on, is left to its timeout.
  StatusOr<std::vector<uint16_t>> LookAtInputRegisters(int first, int count);
  // Goes to the head of the queue and cancels the writes that wait there, so that nothing that was
  // asked for earlier undoes it. Blocks the caller in host time until it is done or has failed.
  Status WriteCoilsAtOnce(int first, std::vector<uint8_t> values);

  const std::string& endpoint() const { return endpoint_; }
  ModbusCounts counts() const;

 private:
  struct Job {
    std::function<Status(_modbus*)> work;
    bool writes = false;
    bool lights = false;   // writes a coil that is on
    bool at_once = false;  // nothing overtakes it
    bool looks = false;    // is not the owner's
    bool done = false;     // guarded by the clock's lock
    Status result;         // set before done
    std::promise<void> finished;
  };
  struct ContextDeleter {
    void operator()(_modbus* context) const;
  };
  using Context = std::unique_ptr<_modbus, ContextDeleter>;

  ModbusBus(RigClock& clock, std::string endpoint, Context context, UniqueFd claim,
            ModbusBusOptions options);
  static StatusOr<Context> TcpContext(std::string_view endpoint);
  static StatusOr<std::unique_ptr<ModbusBus>> Begin(RigClock& clock, std::string endpoint,
                                                    Context context, UniqueFd claim,
                                                    ModbusBusOptions options);
  void Run();
  std::shared_ptr<Job> TakeJob();
  void Finish(const std::shared_ptr<Job>& job, Status result);
  Status Execute(const std::function<Status(_modbus*)>& work);
  Status WriteCoilsNow(_modbus* context, int first, const std::vector<uint8_t>& values);
  Status Failed(std::string_view request);  // by errno; counts it
  Status EnsureConnected();
  void KeepAlive();
  Status Enqueue(const std::shared_ptr<Job>& job);
  StatusOr<std::vector<uint16_t>> ReadRegisters(int first, int count, bool looks);
  bool LeftToItsTimeout() const;

  RigClock& clock_;
  const std::string endpoint_;
  const UniqueFd claim_;  // of Open
  const ModbusBusOptions options_;
  // Of the bus thread:
  Context context_;
  bool connected_ = true;
  bool keep_alive_failed_ = false;
  bool write_failed_ = false;  // the last one
  bool may_be_on_ = true;      // a coil, as far as was confirmed
  RigTime last_telegram_{}, last_request_{};
  // Guarded by the clock's lock. Jobs are shared between the one who waits and the bus thread.
  std::deque<std::shared_ptr<Job>> jobs_;
  bool closing_ = false;
  ModbusCounts counts_;
  RigThread thread_;
};

}  // namespace mesorig::daemon
