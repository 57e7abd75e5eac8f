#pragma once
// Lines of a GPIO chip of the kernel, over libgpiod (gpio_chip.h).
//
// Inputs are watched by edge and read by level. An opening (1 to 0), however short, is told at once; a
// closing when the level has stayed 1 for `debounce`. A chip that is unplugged is opened again when it
// is back: its outputs are set as they were told last, and what changed meanwhile is told. The kernel
// gives a line to one process. An output that is told to fall sooner than `shortest_pulse` after it
// rose falls then: opto-couplers and those who look now and then see every pulse.

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/bus/gpio_chip.h"
#include "daemon/bus/line_port.h"
#include "protocol/base/mutex.h"
#include "protocol/base/unique_fd.h"

namespace mesorig::daemon {

struct GpioLineOptions {
  std::string chip;  // "gpiochip0", or its label
  std::vector<int> inputs, outputs;  // outputs begin at 0
  // Those that the chip's own names tell, whatever their number there is.
  std::map<int, std::string> names;
  std::chrono::milliseconds debounce{20}, shortest_pulse{20};
  std::string consumer = "mesorigd";
};

class GpioLinePort final : public LinePort {
 public:
  // Errors of GpioChip; FailedPrecondition: a line is another process's.
  static StatusOr<std::unique_ptr<GpioLinePort>> Open(RigClock& clock, GpioLineOptions options);
  ~GpioLinePort() override;

  // An input's level as it is now, not debounced; an output's as the chip has it.
  StatusOr<bool> Read(int line) override;
  Status Write(int line, bool level) override;
  void OnEdge(std::function<void(int line, bool level, RigTime when)> handler) override;

  static constexpr std::chrono::milliseconds kRetry{500};

 private:
  using HostTime = std::chrono::steady_clock::time_point;
  struct Input {
    int fd = -1;          // the chip's
    bool told = false;    // the level that was told last
    HostTime closes_at = HostTime::max();  // when a closing is believed
  };
  struct Output {
    bool told = false;
    HostTime rose{};
    HostTime falls_at = HostTime::max();  // it is still 1, and was told 0
  };
  struct Opened {
    std::shared_ptr<GpioChip> chip;
    std::map<int, Input> inputs;
  };

  GpioLinePort(RigClock& clock, GpioLineOptions options);
  StatusOr<Opened> OpenChip() EXCLUDES(mutex_);
  StatusOr<std::shared_ptr<GpioChip>> Chip() const EXCLUDES(mutex_);
  void Run(Opened opened);
  // Waits for edges once. Not OK: the chip is gone.
  Status Look(Opened& opened);
  Status Edge(GpioChip& chip, int line, Input& input);
  Status Settle(GpioChip& chip, int line, Input& input);
  void Tell(int line, Input& input, bool level);
  bool Reopen(Opened& opened);
  // Lets outputs fall whose pulse was long enough; returns when the next one is due.
  StatusOr<HostTime> Fall(GpioChip& chip) EXCLUDES(mutex_);
  void Wake();

  RigClock& clock_;
  const GpioLineOptions options_;
  UniqueFd wake_;  // eventfd
  std::function<void(int, bool, RigTime)> handler_;  // guarded by the clock's lock
  mutable Mutex mutex_;
  std::shared_ptr<GpioChip> chip_ GUARDED_BY(mutex_);  // null: gone
  std::map<int, Output> outputs_ GUARDED_BY(mutex_);
  bool ending_ GUARDED_BY(mutex_) = false;
  std::thread reader_;
};

}  // namespace mesorig::daemon
