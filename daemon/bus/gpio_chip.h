#pragma once
// A GPIO chip of the kernel, as much of libgpiod as a rig needs. Implemented by one file for each API
// of libgpiod: gpio_chip_v1.cc (1.6, Debian 12).

#include <memory>
#include <optional>
#include <string>

#include "protocol/base/status.h"

namespace mesorig::daemon {

// Thread-safe but for Request…; lines that were not requested are InvalidArgument.
class GpioChip {
 public:
  virtual ~GpioChip() = default;
  // `chip`: "gpiochip0", "/dev/gpiochip0", or a chip's label. NotFound.
  static StatusOr<std::unique_ptr<GpioChip>> Open(const std::string& chip);

  virtual int lines() const = 0;
  // The number of the line that the kernel (its device tree, its driver) calls so. NotFound.
  virtual StatusOr<int> Find(const std::string& name) = 0;
  // An input with events at both edges; returns the descriptor that becomes readable with each, the
  // chip's. FailedPrecondition: somebody else has the line, the message says who; InvalidArgument:
  // the chip has no such line.
  virtual StatusOr<int> RequestInput(int line, const std::string& consumer) = 0;
  virtual Status RequestOutput(int line, bool level, const std::string& consumer) = 0;
  // Unavailable when the chip is gone.
  virtual StatusOr<bool> Get(int line) = 0;
  virtual Status Set(int line, bool level) = 0;
  // The oldest edge that waits at an input: to which level. Blocks when there is none.
  virtual StatusOr<bool> TakeEdge(int line) = 0;
};

}  // namespace mesorig::daemon
