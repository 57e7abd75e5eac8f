#pragma once
// Lines of a GPIO chip of the kernel, over libgpiod (gpio_chip.h).
//
// Inputs are watched by edge and read by level. An opening (1 to 0), however short, is told at once; a
// closing when the level has stayed 1 for `debounce`. A chip that is unplugged is opened again when it
// is back: its outputs are set as they were told last, and what changed meanwhile is told. The kernel
// gives a line to one process.

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
  std::chrono::milliseconds debounce{20};
  std::string consumer = "mesorigd";
};

class GpioLinePort final : public LinePort {
 public:
  // Errors of GpioChip.
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

  RigClock& clock_;
  const GpioLineOptions options_;
  UniqueFd wake_;  // eventfd
  std::function<void(int, bool, RigTime)> handler_;  // guarded by the clock's lock
  mutable Mutex mutex_;
  std::shared_ptr<GpioChip> chip_ GUARDED_BY(mutex_);  // null: gone
  std::map<int, bool> written_ GUARDED_BY(mutex_);
  bool ending_ GUARDED_BY(mutex_) = false;
  std::thread reader_;
};

}  // namespace mesorig::daemon
