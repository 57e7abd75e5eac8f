#include "daemon/control/session_run.h"

#include <iterator>

namespace mesorig::daemon {
namespace {

// What a device says when it is gone, silent or was switched off and on; not what a plan got wrong,
// nor steps that were lost (DataLoss): then a person decides what the frames before are worth.
bool Recoverable(const Status& status) {
  return !absl::IsCancelled(status) && !absl::IsInvalidArgument(status) &&
         !absl::IsUnimplemented(status) && !absl::IsDataLoss(status);
}

}  // namespace

SessionRun::SessionRun(const RunContext& context, const SessionJob& job)
    : context_(context),
      job_(job),
      run_(context, {job.resumed, job.accept_reference}),
      storage_(std::make_shared<Storage>()) {
  job.session->OnStorage([storage = storage_, &clock = context.clock](const Status& status) {
    clock.Change([&] { storage->ok = status.ok(); });
  });
  const bool ok = job.session->Storage().ok();
  context.clock.Change([&] { storage_->ok = ok; });
}

SessionRun::~SessionRun() { job_.session->OnStorage({}); }

void SessionRun::Journal(JournalKind kind, std::string text) {
  // (A session that takes no entry takes no frame either, and says so there.)
  const Status status =
      context_.session.Record({kind, context_.clock.Now().count(), -1, 0, std::move(text)});
  if (!status.ok()) context_.on_note(fmt::format("journal: {}", Message(status)));
}

Status SessionRun::Run() {
  Journal(job_.resumed ? JournalKind::kResumed : JournalKind::kBegan, context_.plan.name);
  for (;;) {
    RunResult result = run_.Go();
    if (result.end == RunEnd::kDone) {
      const Status finished = context_.finish();
      if (!absl::IsUnavailable(finished) || context_.session.Storage().ok()) return finished;
      result = {RunEnd::kStorage, finished};
    }
    const bool for_storage = result.end == RunEnd::kStorage;
    if (for_storage && context_.machine.Move(SequencerState::kRunning, SequencerState::kPausing,
                                             Message(result.status))) {
      context_.on_state();
    }
    const Status off = run_.MakeSafe();
    const Status status = Explain(result);
    if (const Status opening = context_.chain.Opening();
        !opening.ok() && !absl::IsCancelled(status)) {
      return status;
    }
    // Nobody is told "at rest", and nothing is tried again, beside something that may still be on.
    if (!off.ok()) {
      return Unavailable("{}; then {}", Message(status), Message(off));
    }
    if (ByHand()) return EndByHand(status);
    const RunOrder order = context_.machine.order();
    if (for_storage || order == RunOrder::kPause || order == RunOrder::kPauseNow) {
      MESORIG_RETURN_IF_ERROR(
          Pause(for_storage && order == RunOrder::kNone, context_.machine.message()));
      continue;
    }
    if (result.end != RunEnd::kFailed || !Recoverable(status)) return status;
    MESORIG_RETURN_IF_ERROR(AwaitDevice(status));
  }
}

Status SessionRun::Explain(const RunResult& result) const {
  Status status = result.status;
  // A command may have overtaken what the run was doing: say why it came.
  const Status stop = context_.devices.stop->Check();
  if (!stop.ok()) status = stop;
  // An open chain cuts torque and lamps: what the devices then report is not the reason.
  if (!ByHand()) (void)context_.chain.Check();
  // Of a command and an opening the one that came first is the reason.
  const Status opening = context_.chain.Opening();
  if (!opening.ok() && (!ByHand() || Message(stop) == Message(opening))) return opening;
  return status;
}

bool SessionRun::ByHand() const {
  const RunOrder order = context_.machine.order();
  return order == RunOrder::kStop || order == RunOrder::kAbort;
}

Status SessionRun::EndByHand(const Status& why) {
  const Status cancelled = Cancelled(
      "{}", absl::IsCancelled(why) ? std::string(Message(why)) : context_.machine.message());
  // Hands may be in the rig, or the chain is open: then nothing moves.
  const bool may_move = context_.machine.order() == RunOrder::kAbort &&
                        !context_.desk.hands_in_the_rig() && context_.safety.MayEnergise().ok();
  if (!may_move) return cancelled;
  context_.chain.Arm();
  context_.machine.LowerStop();
  const Status parked = run_.Park();
  if (parked.ok()) return cancelled;
  context_.on_note(fmt::format("parking: {}", Message(parked)));
  (void)run_.MakeSafe();
  return cancelled;
}

Status SessionRun::Pause(bool for_storage, const std::string& reason) {
  if (!context_.machine.Move(SequencerState::kPausing, SequencerState::kPaused, reason)) {
    return EndByHand(Cancelled("{}", context_.machine.message()));
  }
  Journal(JournalKind::kPaused, reason);
  context_.chain.Disarm();
  context_.on_state();
  context_.activity.Suspend();
  const Status waited = Continue(for_storage);
  context_.activity.Continue();
  MESORIG_RETURN_IF_ERROR(waited);
  if (ByHand()) return EndByHand(Cancelled("{}", context_.machine.message()));
  context_.chain.Arm();
  Journal(JournalKind::kContinued, reason);
  context_.on_state();
  return OkStatus();
}

// Blocks until the machine is told to go on or to end; a pause for the disk goes on by itself.
Status SessionRun::Continue(bool for_storage) {
  bool by_itself = for_storage;
  for (;;) {
    const auto left = [&] {
      return context_.machine.StateInsideChange() != SequencerState::kPaused;
    };
    context_.clock.WaitUntil(kNever, [&] { return left() || (by_itself && storage_->ok); });
    if (context_.machine.state() != SequencerState::kPaused) return OkStatus();
    Status gone_on = context_.safety.MayEnergise();
    if (gone_on.ok()) gone_on = context_.machine.Give(SequencerCommand::kContinue, "");
    if (gone_on.ok() || context_.machine.state() != SequencerState::kPaused) return OkStatus();
    context_.on_note(fmt::format("the disk is fine again; not continued: {}", Message(gone_on)));
    by_itself = false;
  }
}

Status SessionRun::AwaitDevice(const Status& failure) {
  const uint32_t shots = run_.progress().shots_done;
  if (shots != shots_at_failure_) tries_ = 0;
  shots_at_failure_ = shots;
  if (tries_ == std::size(kRecoveryWaits_s)) {
    return Annotate(failure, fmt::format("{} recoveries did not help", tries_));
  }
  const double wait_s = kRecoveryWaits_s[tries_++];
  const std::string text = fmt::format("{}; trying again in {} s", Message(failure), wait_s);
  context_.on_note(text);
  if (context_.machine.Move(SequencerState::kRunning, SequencerState::kRunning, text)) {
    context_.on_state();
  }
  run_.ExpectRecovery(std::string(Message(failure)));
  // (A command ends the wait; the run that follows says what it was.)
  (void)context_.devices.stop->Wait(context_.clock.Now() + FromSeconds(wait_s),
                                    [] { return false; });
  context_.machine.Move(SequencerState::kRunning, SequencerState::kRunning, "");
  return OkStatus();
}

}  // namespace mesorig::daemon
