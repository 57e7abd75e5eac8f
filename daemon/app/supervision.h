#pragma once
// What a daemon that serves has around it: watchdog, metrics, notifications, health and what a
// support bundle tells, and how it follows a reload. Made when everything else runs.

#include <functional>
#include <memory>
#include <vector>

#include "daemon/app/settings.h"
#include "daemon/app/attached_rig.h"
#include "daemon/app/watchdog.h"
#include "daemon/service/access.h"
#include "daemon/service/daemon_service.h"
#include "daemon/service/metrics.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

// Borrows everything. Of the main thread; metrics and diagnostics are collected on others.
class Supervision {
 public:
  static StatusOr<std::unique_ptr<Supervision>> Start(const Settings& settings, const Rig& rig,
                                                      AttachedRig& devices, DaemonService& service,
                                                      Access& access,
                                                      const ServiceManager& manager);
  ~Supervision();

  // Call often; twice a second it feeds the watchdog, tells systemd and the health service.
  void Look();
  // Takes up what can change while the daemon runs; logs what cannot.
  void Reload(const Settings& settings);
  // A port of its own choosing; 0: no metrics.
  int metrics_port() const { return metrics_ ? metrics_->port() : 0; }

 private:
  Supervision(const Settings& settings, const Rig& rig, AttachedRig& devices,
              DaemonService& service, Access& access, const ServiceManager& manager);
  std::vector<ProgressSource> Sources();
  // Host time for which a rig thread has been running without a sign of life.
  std::chrono::nanoseconds RigSilence();
  void StartNotifiers(const NotifierOptions& options);
  std::vector<Sample> Samples();
  std::vector<DiagnosticFile> Diagnose();

  const Rig& rig_;
  AttachedRig& devices_;
  DaemonService& service_;
  Access& access_;
  const ServiceManager& manager_;
  Watchdog watchdog_;
  std::optional<std::chrono::steady_clock::time_point> looked_;
  std::string told_;  // to systemd

  Mutex mutex_;
  Settings settings_ GUARDED_BY(mutex_);
  std::vector<std::unique_ptr<Notifier>> notifiers_ GUARDED_BY(mutex_);
  uint64_t verified_ GUARDED_BY(mutex_) = 0;  // frames read again, when that last changed
  std::chrono::steady_clock::time_point verified_at_ GUARDED_BY(mutex_);

  std::unique_ptr<MetricsServer> metrics_;
};

}  // namespace mesorig::daemon
