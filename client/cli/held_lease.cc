#include "client/cli/held_lease.h"

#include <chrono>
#include <cstdio>

namespace mesorig::client {
namespace {

constexpr std::chrono::milliseconds kLook{50};
volatile std::sig_atomic_t interrupted = 0;

}  // namespace

bool Interrupted() { return interrupted != 0; }

void InstallInterrupt() {
  const auto note = [](int) { interrupted = 1; };
  std::signal(SIGINT, note);
  std::signal(SIGTERM, note);
}

StatusOr<std::unique_ptr<HeldLease>> HeldLease::Take(DaemonClient& daemon, uint64_t token,
                                                     double span_s, bool take) {
  if (token != 0) return std::unique_ptr<HeldLease>(new HeldLease(daemon, token));
  MESORIG_ASSIGN_OR_RETURN(const v1::LeaseStatus lease, daemon.AcquireLease(span_s, take));
  std::unique_ptr<HeldLease> held(new HeldLease(daemon, lease.token()));
  held->renewing_ =
      std::thread([&held = *held, every_s = lease.left_s() / 3] { held.Renew(every_s); });
  return held;
}

void HeldLease::Renew(double every_s) {
  auto due = std::chrono::steady_clock::now();
  while (!ending_) {
    std::this_thread::sleep_for(kLook);
    if (std::chrono::steady_clock::now() < due) continue;
    due = std::chrono::steady_clock::now() +
          std::chrono::milliseconds(static_cast<int64_t>(every_s * 1000));
    const auto renewed = daemon_.RenewLease(token_);
    if (renewed.ok()) continue;
    std::fprintf(stderr, "mesorig: %s\n", std::string(Message(renewed.status())).c_str());
    lost_ = true;
    return;
  }
}

HeldLease::~HeldLease() {
  if (!own()) return;
  ending_ = true;
  renewing_.join();
  if (lost_) return;
  const auto released = daemon_.ReleaseLease(token_);
  if (!released.ok()) {
    std::fprintf(stderr, "mesorig: %s\n", std::string(Message(released.status())).c_str());
  }
}

}  // namespace mesorig::client
