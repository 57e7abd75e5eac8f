#pragma once
// The contactor that e-stop and door open: it cuts the supply of lamps and the torque of drives.
// It latches open; it closes again on a reset edge while the chain is closed, and closing the chain
// never closes it. Called by the dispatcher only.

#include <functional>
#include <vector>

#include "protocol/base/clocks.h"

namespace mesorig::simulator {

class Contactor {
 public:
  bool closed() const { return closed_; }
  void SetChain(bool chain_closed, RigTime now);
  void ResetEdge(RigTime now);
  void Weld() { welded_ = true; }  // it does not open any more
  // Called at each change, in order of registration.
  void OnChange(std::function<void(bool closed, RigTime now)> listener) {
    listeners_.push_back(std::move(listener));
  }

 private:
  void Set(bool closed, RigTime now);
  bool closed_ = true, chain_closed_ = true, welded_ = false;
  std::vector<std::function<void(bool, RigTime)>> listeners_;
};

}  // namespace mesorig::simulator
