#include "daemon/service/call_book.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/support/server_interceptor.h>
#include <pthread.h>

#include "daemon/service/caller.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

namespace ge = grpc::experimental;

// Of one call, made and destroyed by gRPC.
class CallWatch final : public ge::Interceptor {
 public:
  CallWatch(CallBook& book, ge::ServerRpcInfo& info) : book_(book), info_(info) {}
  ~CallWatch() override { book_.Leave(this); }

  void Intercept(ge::InterceptorBatchMethods* methods) override {
    using Point = ge::InterceptionHookPoints;
    if (methods->QueryInterceptionHookPoint(Point::POST_RECV_INITIAL_METADATA)) {
      book_.Enter(this, info_.server_context());
    }
    if (methods->QueryInterceptionHookPoint(Point::PRE_SEND_MESSAGE)) book_.Writing(this, true);
    if (methods->QueryInterceptionHookPoint(Point::POST_SEND_MESSAGE)) book_.Writing(this, false);
    // From here on the context may go: nobody may cancel it.
    if (methods->QueryInterceptionHookPoint(Point::PRE_SEND_STATUS)) book_.Leave(this);
    methods->Proceed();
  }

 private:
  CallBook& book_;
  ge::ServerRpcInfo& info_;
};

class CallWatches final : public ge::ServerInterceptorFactoryInterface {
 public:
  explicit CallWatches(CallBook& book) : book_(book) {}
  ge::Interceptor* CreateServerInterceptor(ge::ServerRpcInfo* info) override {
    return new CallWatch(book_, *info);  // gRPC's from here
  }

 private:
  CallBook& book_;
};

}  // namespace

CallBook::CallBook(CallLimits limits, Welcome welcome)
    : limits_(limits), welcome_(std::move(welcome)), thread_([this] {
        ::pthread_setname_np(::pthread_self(), "calls");
        Run();
      }) {}

CallBook::~CallBook() {
  {
    MutexLock lock(mutex_);
    end_ = true;
    changed_.NotifyAll();
  }
  thread_.join();
}

std::unique_ptr<ge::ServerInterceptorFactoryInterface> CallBook::MakeWatches() {
  return std::make_unique<CallWatches>(*this);
}

std::string CallBook::KeyOf(std::string_view role, std::string_view name, std::string_view via) {
  return via.empty() ? fmt::format("{} {}", role, name)
                     : fmt::format("{} {} via {}", role, name, via);
}

Status CallBook::Room(const std::string& who) const {
  MutexLock lock(mutex_);
  const auto own = of_one_.find(who);
  if (own != of_one_.end() && own->second >= limits_.calls_of_one) {
    return absl::ResourceExhaustedError(fmt::format(
        "{} calls of this caller are under way, the most that one may have", own->second));
  }
  if (calls_.size() < limits_.calls) return OkStatus();
  return absl::ResourceExhaustedError(
      fmt::format("{} calls are under way, the most that are taken", calls_.size()));
}

size_t CallBook::size() const {
  MutexLock lock(mutex_);
  return calls_.size();
}

void CallBook::Enter(const void* call, const grpc::ServerContextBase* context) {
  const Caller caller = CallerOf(*context);
  Call entry;
  entry.context = context;
  entry.who = KeyOf(Name(caller.role), caller.name, caller.via);
  MutexLock lock(mutex_);
  ++of_one_[entry.who];
  calls_[call] = std::move(entry);
}

void CallBook::Leave(const void* call) {
  MutexLock lock(mutex_);
  while (cutting_ == call && std::this_thread::get_id() != thread_.get_id()) {
    changed_.Wait(mutex_);
  }
  const auto at = calls_.find(call);
  if (at == calls_.end()) return;
  const auto own = of_one_.find(at->second.who);
  if (--own->second == 0) of_one_.erase(own);
  calls_.erase(at);
}

void CallBook::Writing(const void* call, bool begins) {
  MutexLock lock(mutex_);
  const auto at = calls_.find(call);
  if (at != calls_.end()) {
    at->second.writing_since = begins ? std::chrono::steady_clock::now() : Time::max();
  }
}

void CallBook::Run() {
  for (;;) {
    {
      MutexLock lock(mutex_);
      if (!end_) changed_.WaitFor(mutex_, limits_.look);
      if (end_) return;
    }
    while (CutOne()) {
    }
  }
}

Status CallBook::WhyEnd(const Call& call, Time now) const {
  if (call.writing_since < now - limits_.stall) {
    return DeadlineExceeded("its client takes nothing for {} ms", limits_.stall.count());
  }
  return welcome_(*call.context);
}

// TryCancel runs completions of the call on this thread, which come back to Writing and Leave: not
// under the lock. Any other thread that ends the call waits in Leave, so that its context stays.
bool CallBook::CutOne() {
  const grpc::ServerContextBase* context = nullptr;
  {
    MutexLock lock(mutex_);
    const Time now = std::chrono::steady_clock::now();
    for (auto& [id, call] : calls_) {
      if (call.cut) continue;
      const Status why = WhyEnd(call, now);
      if (why.ok()) continue;
      Log("access").warn("a call of {} is cut off: {}", call.who, Message(why));
      call.cut = true;
      cutting_ = id;
      context = call.context;
      break;
    }
  }
  if (context == nullptr) return false;
  context->TryCancel();
  MutexLock lock(mutex_);
  cutting_ = nullptr;
  changed_.NotifyAll();
  return true;
}

}  // namespace mesorig::daemon
