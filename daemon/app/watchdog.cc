#include "daemon/app/watchdog.h"

#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr std::chrono::seconds kLimitWithoutManager{15};  // for the log alone

}  // namespace

Watchdog::Watchdog(const ServiceManager& manager, std::vector<ProgressSource> sources)
    : manager_(manager),
      sources_(std::move(sources)),
      limit_(manager.watchdog() ? std::chrono::nanoseconds(*manager.watchdog()) / 2
                                : std::chrono::nanoseconds(kLimitWithoutManager)) {}

std::string Watchdog::Look(HostClock::time_point now) {
  std::string silent;
  std::chrono::nanoseconds longest{};
  for (const Silence& source : Silences()) {
    if (source.silent <= limit_ || source.silent <= longest) continue;
    longest = source.silent;
    silent = source.name;
  }
  if (silent != silent_) {
    if (!silent.empty()) {
      Log("program").critical("{} makes no progress since {:.1f} s{}", silent,
                              std::chrono::duration<double>(longest).count(),
                              manager_.watchdog() ? ": the watchdog is not fed" : "");
    } else {
      Log("program").warn("{} makes progress again", silent_);
    }
    silent_ = silent;
  }
  if (!silent.empty() || !manager_.watchdog()) return silent;
  if (fed_ && now - *fed_ < *manager_.watchdog() / 4) return silent;
  fed_ = now;
  if (const Status status = manager_.Alive(); !status.ok()) {
    Log("program").warn("watchdog: {}", Message(status));
  }
  return silent;
}

std::vector<Watchdog::Silence> Watchdog::Silences() const {
  std::vector<Silence> silences;
  for (const ProgressSource& source : sources_) {
    silences.push_back({source.name, source.silent_for()});
  }
  return silences;
}

}  // namespace mesorig::daemon
