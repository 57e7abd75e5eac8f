#pragma once
// What the services share: sessions, events, the audit log, the lease. Each is thread-safe.

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>

#include "daemon/control/manual_control.h"
#include "daemon/control/sequencer.h"
#include "daemon/service/audit_log.h"
#include "daemon/service/consumer_book.h"
#include "daemon/service/event_log.h"
#include "daemon/service/lease_keeper.h"
#include "daemon/service/session_store.h"

namespace mesorig::daemon {

// Shared with the sequencer's listener: one call of it may still be under way when the service
// goes.
struct Books {
  // `manual`, borrowed until `lease` is closed, is told which token may command; null: nobody is.
  // Errors of the audit log and of the lease's file.
  static StatusOr<std::shared_ptr<Books>> Open(std::filesystem::path state_dir,
                                               ManualControl* manual,
                                               std::function<double()> rig_s);

  SessionStore sessions;
  EventLog events;
  ConsumerBook consumers;
  std::unique_ptr<AuditLog> audit;
  std::unique_ptr<LeaseKeeper> lease;
  std::atomic<uint64_t> run_token{0};  // of the plan under way, or the last one

  // A plan ended: its lease with it. Recorded, and the audit log's head noted elsewhere.
  void EndSession(const SequencerEvent& event);

  explicit Books(std::filesystem::path state_dir) : sessions(std::move(state_dir)) {}

 private:
  void TellLease(const LeaseChange& change);
};

}  // namespace mesorig::daemon
