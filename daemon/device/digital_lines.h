#pragma once
// Digital lines. Inputs are read by level; those of the interlock chain are normally closed: true is
// closed (good), and a failed read is an open chain.

#include <functional>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

class DigitalLines {
 public:
  virtual ~DigitalLines() = default;
  // The line's level now, read from the device. Any thread.
  virtual StatusOr<bool> Read(int line) = 0;
  // Sets an output. Any thread.
  virtual Status Write(int line, bool level) = 0;
  // `on_edge` is called under the rig clock's lock (inside Change): it stores and returns. One
  // listener; set before the clock's first activity.
  virtual void OnEdge(std::function<void(int line, bool level, RigTime when)> on_edge) = 0;
};

}  // namespace mesorig::daemon
