#pragma once
// A thread that is a member of the rig clock for its whole life. The constructor returns when the
// member is registered, so that virtual time cannot pass before the thread takes part in it.

#include <functional>
#include <string>
#include <thread>

#include "protocol/base/clocks.h"

namespace mesorig::daemon {

// The owner makes `body` return (by a flag changed inside RigClock::Change) before it destroys the
// thread; the destructor joins. Declare it as the owner's last member.
class RigThread {
 public:
  RigThread(RigClock& clock, std::string name, std::function<void()> body);
  ~RigThread();
  RigThread(const RigThread&) = delete;
  RigThread& operator=(const RigThread&) = delete;

 private:
  std::thread thread_;
};

}  // namespace mesorig::daemon
