#include "daemon/service/books.h"

namespace mesorig::daemon {

StatusOr<std::shared_ptr<Books>> Books::Open(std::filesystem::path state_dir, ManualControl* manual,
                                             std::function<double()> rig_s) {
  auto books = std::make_shared<Books>(state_dir);
  AuditOptions audit;
  audit.rig_s = std::move(rig_s);
  MESORIG_ASSIGN_OR_RETURN(books->audit, AuditLog::Open(state_dir, std::move(audit)));
  LeaseHooks hooks;
  if (manual != nullptr) {
    hooks.admit = [manual](uint64_t token) { manual->Admit(token); };
    hooks.close = [manual](uint64_t newest) { manual->Close(newest, "the lease is over"); };
  }
  hooks.changed = [books = books.get()](const LeaseChange& change) { books->TellLease(change); };
  MESORIG_ASSIGN_OR_RETURN(books->lease, LeaseKeeper::Open(state_dir, std::move(hooks)));
  return books;
}

// Under the keeper's lock.
void Books::TellLease(const LeaseChange& change) {
  using Kind = LeaseChange::Kind;
  v1::Event event;
  v1::LeaseChanged& told = *event.mutable_lease();
  told.set_change(std::string(Name(change.kind)));
  told.set_holder(change.holder);
  told.set_requester(change.requester);
  events.Append(std::move(event));
  // What a call did is recorded with the call.
  if (change.kind != Kind::kExpired) return;
  AuditEntry entry;
  entry.caller.name = change.holder;
  entry.call = "lease/expired";
  entry.what = fmt::format("lease {} was not renewed; everything is switched off", change.token);
  entry.outcome = "OK";
  audit->RecordLater(std::move(entry));
}

void Books::EndSession(const SequencerEvent& event) {
  lease->EndRun(run_token);
  AuditEntry entry;
  entry.caller.name = "mesorigd";
  entry.call = "session/ended";
  entry.what = fmt::format("session_id: \"{}\"", event.status.session_id);
  entry.outcome = event.complete ? "OK" : "INCOMPLETE: " + event.text;
  audit->RecordLater(std::move(entry));
  audit->Anchor();
}

}  // namespace mesorig::daemon
