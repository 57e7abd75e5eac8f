#pragma once
// The calls that are under way, of all services: how many somebody has; a stream whose client takes
// nothing, or whose caller may not have it any more, is cut off. An interceptor in the server tells
// it of every call, sync or callback: no method has to.

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "protocol/base/mutex.h"
#include "protocol/base/status.h"

namespace grpc {
class ServerContextBase;
namespace experimental {
class ServerInterceptorFactoryInterface;
}
}  // namespace grpc

namespace mesorig::daemon {

struct CallLimits {
  size_t calls = 1024;                      // under way, of everybody
  size_t calls_of_one = 256;                // a consumer of frames has one a camera and session
  std::chrono::milliseconds stall{60'000};  // that a client may leave a message untaken
  std::chrono::milliseconds look{500};      // how often that is looked at
};

// Thread-safe; one thread of its own. Outlives the server that it watches.
class CallBook {
 public:
  // Why a call that goes on must end; OK: it may go on.
  using Welcome = std::function<Status(const grpc::ServerContextBase& context)>;
  CallBook(CallLimits limits, Welcome welcome);
  ~CallBook();
  // For the server's builder, once.
  std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> MakeWatches();
  // ResourceExhausted: `who` has as many calls as he may, or all together have.
  Status Room(const std::string& who) const;
  // As Room counts: one person, through one gateway or none.
  static std::string KeyOf(std::string_view role, std::string_view name, std::string_view via);
  size_t size() const;

  // Of the interceptor.
  void Enter(const void* call, const grpc::ServerContextBase* context);
  void Leave(const void* call);
  void Writing(const void* call, bool begins);

 private:
  using Time = std::chrono::steady_clock::time_point;
  struct Call {
    const grpc::ServerContextBase* context = nullptr;
    std::string who;
    Time writing_since = Time::max();
    bool cut = false;
  };
  void Run();
  // Cuts off one call that must end; false: there is none.
  bool CutOne() EXCLUDES(mutex_);
  Status WhyEnd(const Call& call, Time now) const;

  const CallLimits limits_;
  const Welcome welcome_;
  mutable Mutex mutex_;
  CondVar changed_;
  bool end_ GUARDED_BY(mutex_) = false;
  std::map<const void*, Call> calls_ GUARDED_BY(mutex_);
  std::map<std::string, size_t> of_one_ GUARDED_BY(mutex_);
  const void* cutting_ GUARDED_BY(mutex_) = nullptr;  // may not leave meanwhile
  std::thread thread_;
};

}  // namespace mesorig::daemon
