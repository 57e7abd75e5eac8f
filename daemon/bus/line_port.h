#pragma once
// Digital lines of one chip: the kernel's or the simulator's.

#include <functional>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

class LinePort {
 public:
  virtual ~LinePort() = default;
  // The level now. Any thread. Unavailable when the chip or the simulator is gone.
  virtual StatusOr<bool> Read(int line) = 0;
  // Sets an output. Any thread; errors as Read.
  virtual Status Write(int line, bool level) = 0;
  // `handler` is called under the rig clock's lock (inside Change): it stores and returns. One
  // handler, set before the clock's first activity.
  virtual void OnEdge(std::function<void(int line, bool level, RigTime when)> handler) = 0;
};

}  // namespace mesorig::daemon
