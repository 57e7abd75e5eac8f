#pragma once
// The lease of one command: renewed by a thread as long as the object lives.

#include <atomic>
#include <csignal>
#include <memory>
#include <thread>

#include "client/connection/daemon_client.h"

namespace mesorig::client {

// True from the first SIGINT or SIGTERM after InstallInterrupt on: what is done by hand ends.
bool Interrupted();
void InstallInterrupt();

class HeldLease {
 public:
  // `token` not 0: somebody else renews it (`mesorig lease take`). Else a lease of our own, which
  // ends with the object: then the daemon switches everything off.
  static StatusOr<std::unique_ptr<HeldLease>> Take(DaemonClient& daemon, uint64_t token,
                                                   double span_s = 0, bool take = false);
  ~HeldLease();
  uint64_t token() const { return token_; }
  bool own() const { return renewing_.joinable(); }
  // Not renewed any more: it was taken, or the daemon is gone.
  bool lost() const { return lost_; }

 private:
  HeldLease(DaemonClient& daemon, uint64_t token) : daemon_(daemon), token_(token) {}
  void Renew(double every_s);

  DaemonClient& daemon_;
  const uint64_t token_;
  std::atomic<bool> ending_{false}, lost_{false};
  std::thread renewing_;
};

}  // namespace mesorig::client
