#pragma once
// The lease of one daemon: the rules (lease_book.h) with a clock, a thread that ends what expires,
// and tokens that grow over restarts. Tells whoever commands devices which token is the newest, and
// when nobody may command any more.

#include <filesystem>
#include <functional>
#include <memory>
#include <thread>

#include "daemon/service/lease_book.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

inline constexpr std::string_view kLeaseFile = "lease.token";

// All called with the keeper's lock held, so that their order is that of the leases: they return at
// once, and do not call it.
struct LeaseHooks {
  std::function<void(uint64_t token)> admit;   // this token may command, and no other
  std::function<void(uint64_t newest)> close;  // no token up to this one may: everything off
  std::function<void(const LeaseChange&)> changed;
  std::function<LeaseTime()> now = std::chrono::steady_clock::now;
};

// Thread-safe.
class LeaseKeeper {
 public:
  // The state folder's file holds a number that no token has reached. Unavailable, InvalidArgument:
  // the file.
  static StatusOr<std::unique_ptr<LeaseKeeper>> Open(const std::filesystem::path& state_dir,
                                                     LeaseHooks hooks);
  ~LeaseKeeper();

  // As the book's. Unavailable: the state folder takes nothing.
  StatusOr<uint64_t> Acquire(const Caller& caller, std::chrono::milliseconds span, bool take);
  Status Renew(const Caller& caller, uint64_t token);
  Status Release(const Caller& caller, uint64_t token);
  Status Request(const Caller& caller);
  Status Check(const Caller& caller, uint64_t token);
  Status CheckFree(const Caller& caller, uint64_t token);
  StatusOr<uint64_t> BeginRun(const Caller& caller, uint64_t token);
  void EndRun(uint64_t token);
  LeaseState State();
  // Ends its thread; no hook is called any more.
  void Close();
  // Looks at the clock now: for a clock that a test moves.
  void Look();

 private:
  LeaseKeeper(std::filesystem::path file, uint64_t last_token, LeaseHooks hooks);
  Status Reserve() REQUIRES(mutex_);
  void Tell() REQUIRES(mutex_);
  void Loop();

  const std::filesystem::path file_;
  const LeaseHooks hooks_;
  Mutex mutex_;
  CondVar changed_;
  LeaseBook book_ GUARDED_BY(mutex_);
  uint64_t reserved_ GUARDED_BY(mutex_) = 0;  // tokens up to this one may be given
  bool ending_ GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace mesorig::daemon
