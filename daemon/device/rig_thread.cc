#include "daemon/device/rig_thread.h"

#include <future>

namespace mesorig::daemon {

RigThread::RigThread(RigClock& clock, std::string name, std::function<void()> body) {
  std::promise<void> registered;
  std::future<void> ready = registered.get_future();
  thread_ = std::thread([&clock, name = std::move(name), body = std::move(body),
                         registered = std::move(registered)]() mutable {
    RigClock::Member member(clock, std::move(name));
    registered.set_value();
    body();
  });
  ready.wait();
}

RigThread::~RigThread() { thread_.join(); }

}  // namespace mesorig::daemon
