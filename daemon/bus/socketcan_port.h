#pragma once
// A CAN interface of the kernel (SocketCAN, raw socket; Linux, Documentation/networking/can.rst):
// data frames with 11-bit identifiers, and the controller's error frames.
//
// Lost and found: an interface that goes down, or whose adapter is unplugged, is looked for by its
// name every kRetry; meanwhile Send is Unavailable, with the reason. A controller that is bus-off is
// restarted by the system (`ip link set can0 type can restart-ms 100`) or a person; until it says so,
// nothing is sent. One process has an interface: a second one is refused with the first one's pid.

#include <linux/can.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "daemon/bus/can_port.h"
#include "protocol/base/mutex.h"
#include "protocol/base/unique_fd.h"

namespace mesorig::daemon {

// What an error frame says (linux/can/error.h). Of several things the worst one counts.
enum class CanTrouble {
  kNone,       // a controller that recovered: error-active again, or restarted
  kNoise,      // a protocol violation, arbitration lost: the controller sends again
  kWarning,    // error counters above 96
  kPassive,    // above 127: no acknowledgements, for example a cable that is out
  kOverflow,   // frames were lost in the controller
  kBusOff,     // above 255: the controller takes no part any more
};
std::string_view Text(CanTrouble trouble);
// `frame` has CAN_ERR_FLAG; any content is permitted.
CanTrouble TroubleOf(const can_frame& frame);
// InvalidArgument: an extended identifier, a remote request, an error frame, or more than 8 bytes.
StatusOr<CanFrame> FromKernel(const can_frame& frame);

struct CanPortFigures {
  uint64_t sent = 0, received = 0;
  uint64_t error_frames = 0, foreign = 0;  // foreign: what FromKernel refuses
  uint64_t lost = 0;                       // received ones that the socket had no room for
  uint64_t bus_off = 0, reconnects = 0;
  CanTrouble trouble = CanTrouble::kNone;  // the last word of the controller
};

class SocketCanPort final : public CanPort {
 public:
  // `interface`: "can0". NotFound: there is none of that name; FailedPrecondition: another process
  // has it, or it is no CAN interface. One that is down is no error: it may come up later.
  static StatusOr<std::unique_ptr<SocketCanPort>> Open(RigClock& clock, const std::string& interface);
  ~SocketCanPort() override;

  // Waits at most kSendLimit for room in the interface's queue. Unavailable: the interface is down
  // or gone, bus-off, or takes nothing (nobody acknowledges).
  Status Send(const CanFrame& frame) override;
  void OnFrame(std::function<void(RigTime, const CanFrame&)> handler) override;

  // OK: up, and the controller takes part. Any thread.
  Status Health() const EXCLUDES(mutex_);
  CanPortFigures figures() const EXCLUDES(mutex_);

  static constexpr std::chrono::milliseconds kRetry{200}, kSendLimit{50};

 private:
  SocketCanPort(RigClock& clock, std::string interface, UniqueFd claim);
  Status Connect() EXCLUDES(mutex_);
  void Run();
  // False: the socket has nothing more, or is gone.
  bool Receive(int fd) EXCLUDES(mutex_);
  void Lose(std::string why) EXCLUDES(mutex_);
  bool IsUp() const;

  RigClock& clock_;
  const std::string interface_;
  const UniqueFd claim_;  // held for the process's life: an abstract socket
  UniqueFd wake_;         // eventfd
  std::function<void(RigTime, const CanFrame&)> handler_;  // guarded by the clock's lock
  mutable Mutex mutex_;
  std::shared_ptr<UniqueFd> socket_ GUARDED_BY(mutex_);  // null: none
  std::string lost_ GUARDED_BY(mutex_);                  // why there is none
  CanPortFigures figures_ GUARDED_BY(mutex_);
  bool ending_ GUARDED_BY(mutex_) = false;
  std::thread reader_;
};

}  // namespace mesorig::daemon
