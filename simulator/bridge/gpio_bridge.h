#pragma once
// The simulated rig's lines on a chip of the kernel's gpio-sim (Documentation/admin-guide/gpio/
// gpio-sim.rst): inputs of the daemon are pulled through sysfs, outputs are read there. gpio-sim tells
// nobody when an output changes, so they are looked at every kLook: pulses of 20 ms are seen.

#include <atomic>
#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::simulator {

struct GpioBridgeOptions {
  std::string label;                 // of the chip, in configfs
  std::vector<int> inputs, outputs;  // as the daemon sees them
};

class GpioBridge {
 public:
  // Borrows the link. NotFound: no chip of gpio-sim has that label; Unavailable: it has no such line.
  static StatusOr<std::unique_ptr<GpioBridge>> Open(sim_wire::SimLink& link,
                                                    GpioBridgeOptions options);
  ~GpioBridge();

  static constexpr std::chrono::milliseconds kLook{2};
  // A contact that opens and closes in one instant of the simulation is held so long.
  static constexpr std::chrono::milliseconds kHold{100};

 private:
  struct Input {
    std::deque<bool> due;  // levels, oldest first
    bool level = false;    // as pulled last
    std::chrono::steady_clock::time_point next{};  // when the next one may be
  };
  GpioBridge(sim_wire::SimLink& link, uint16_t device, GpioBridgeOptions options);
  // The lines' folder, and every input pulled as it is to be.
  Status FindChip() EXCLUDES(mutex_);
  Status Pull(int line, bool level) const;
  StatusOr<bool> Value(int line) const;
  void Run();
  Status Look() EXCLUDES(mutex_);

  sim_wire::SimLink& link_;
  const uint16_t device_;
  const GpioBridgeOptions options_;
  std::string lines_;              // of the thread: /sys/devices/platform/gpio-sim.N/gpiochipM
  std::map<int, bool> outputs_;    // likewise: as seen last
  Mutex mutex_;
  std::map<int, Input> inputs_ GUARDED_BY(mutex_);
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace mesorig::simulator
