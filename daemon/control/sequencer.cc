#include "daemon/control/sequencer.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <utility>

#include "daemon/control/reading_board.h"
#include "daemon/control/run_context.h"
#include "daemon/control/session_run.h"
#include "daemon/control/state_machine.h"
#include "daemon/device/rig_thread.h"
#include "protocol/base/check.h"
#include "protocol/base/log.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;
using Kind = SequencerEvent::Kind;

constexpr RigTime kIdleRefresh{1'000'000'000};

class SequencerImpl final : public Sequencer {
 public:
  SequencerImpl(RigClock& clock, const Rig& rig, Devices devices,
                std::function<bool()> deterministic, Safety* safety);
  ~SequencerImpl() override;
  Status CheckBegin(SequencerCommand how, const CompiledPlan& plan) override;
  Status Begin(SequencerCommand how, SessionJob job) override;
  Status Command(SequencerCommand command, std::string_view reason) override;
  Status Stop(std::string_view reason) override;
  Status Acknowledge(uint32_t prompt_id) override;
  SequencerStatus GetStatus() const override;
  void OnEvent(std::function<void(const SequencerEvent&)> listener) override;
  Safety* safety() override { return &safety_; }

 private:
  struct Times {
    RigTime start{};
    HostClock::time_point wall_start;
    double virtual_s = 0, wall_s = 0, preparation_s = 0;
  };
  void ReadClocks(Times& times) const;
  void Loop();
  void RunJob(const SessionJob& job);
  // False: it was told to end before it began; `why` says.
  bool AwaitStart(Status& why);
  Status RunInActivity(const SessionJob& job, Times& times);
  RunContext MakeContext(const SessionJob& job, RigClock::Activity& activity, Times& times);
  void EndIncomplete(const SessionJob& job, const Status& why, const Times& times);
  void Emit(Kind kind, std::string_view text,
            const std::function<void(SequencerEvent&)>& fill = nullptr);
  void OnProgress(const SessionJob& job, const RunProgress& progress);
  bool OnWait(bool waiting);
  void RefreshIdleReadings();

  RigClock& clock_;
  const Rig& rig_;
  const std::unique_ptr<Safety> own_safety_;  // when none was given
  Safety& safety_;
  const Devices devices_;  // as Safety lets them be used
  const std::function<bool()> deterministic_;
  StateMachine machine_;
  InterlockChain& chain_;
  OperatorDesk desk_;
  ReadingBoard board_;
  std::atomic<uint32_t> frames_durable_{0};
  // Guarded by the clock's lock:
  std::optional<SessionJob> job_;
  bool closing_ = false;
  SequencerStatus status_;          // but for what the machine and the board hold
  std::weak_ptr<Session> session_;  // of the run under way
  RigTime run_started_{};
  bool finished_ = false;  // the end is written; of the sequencer's thread

  mutable Mutex listener_mutex_;
  std::function<void(const SequencerEvent&)> listener_ GUARDED_BY(listener_mutex_);
  RigThread thread_;
  const Listening stops_;
};

std::unique_ptr<Safety> MakeSafety(RigClock& clock, const Rig& rig, const Devices& devices) {
  return std::make_unique<Safety>(
      clock, rig, SafetyDevices{devices.axes, devices.lamps, devices.lines}, *devices.stop);
}

Devices Guarded(Devices devices, const Safety& safety) {
  devices.axes = safety.axes();
  devices.lamps = safety.lamps();
  return devices;
}

SequencerImpl::SequencerImpl(RigClock& clock, const Rig& rig, Devices devices,
                             std::function<bool()> deterministic, Safety* safety)
    : clock_(clock),
      rig_(rig),
      own_safety_(safety == nullptr ? MakeSafety(clock, rig, devices) : nullptr),
      safety_(safety == nullptr ? *own_safety_ : *safety),
      devices_(Guarded(std::move(devices), safety_)),
      deterministic_(std::move(deterministic)),
      machine_(clock, *devices_.stop),
      chain_(safety_.chain()),
      desk_(clock, chain_, *devices_.stop),
      board_(rig),
      thread_(clock, "sequencer", [this] { Loop(); }),
      // A stop that did not come by way of Stop; the sequencer's thread follows.
      stops_(safety_.OnStop([this](std::string_view reason) {
        (void)machine_.Give(SequencerCommand::kStop, reason);
      })) {}

SequencerImpl::~SequencerImpl() {
  if (const Status status = Stop("the daemon ends"); !status.ok()) {
    Log("control").error("{}", Message(status));
  }
  clock_.Change([&] { closing_ = true; });
}

Status SequencerImpl::CheckBegin(SequencerCommand how, const CompiledPlan& plan) {
  MESORIG_RETURN_IF_ERROR(machine_.Check(how));
  if (plan.rig_sha256 != rig_.sha256) {
    return InvalidArgument("plan {} was compiled for a rig with SHA-256 {}, this one has {}",
                           plan.name, plan.rig_sha256, rig_.sha256);
  }
  if (plan.sweeps > 0 && !rig_.lines.interlock) {
    return FailedPrecondition("plan {} has {} sweeps of a laser, and rig {} has no interlock",
                              plan.name, plan.sweeps, rig_.name);
  }
  // A console's start has seen what tripped.
  const Status permit = safety_.Reset();
  board_.SetChain(chain_.levels());
  return permit;
}

Status SequencerImpl::Begin(SequencerCommand how, SessionJob job) {
  MESORIG_RETURN_IF_ERROR(CheckBegin(how, job.plan));
  return machine_.Give(how, "", [&] {
    if (job_ || closing_) return FailedPrecondition("the session before is not at its end yet");
    status_ = {};
    status_.session_id = job.session->id();
    status_.shots = job.plan.shots;
    status_.estimated_s = status_.remaining_s = job.plan.seconds;
    status_.bytes_left = job.plan.frame_bytes;
    session_ = job.session;
    run_started_ = {};
    frames_durable_ = 0;
    job_ = std::move(job);
    return OkStatus();
  });
}

Status SequencerImpl::Command(SequencerCommand command, std::string_view reason) {
  MESORIG_RETURN_IF_ERROR(machine_.Check(command));
  if (command == SequencerCommand::kStart || command == SequencerCommand::kContinue) {
    MESORIG_RETURN_IF_ERROR(safety_.Reset());
  }
  // A bank that did not answer when the fault came may have left lamps on.
  if (command == SequencerCommand::kReset) {
    MESORIG_RETURN_IF_ERROR(devices_.lamps->AllOff());
    // (What still forbids to energise is told to whoever wants to.)
    if (const Status permit = safety_.Reset(); !permit.ok()) Log("control").info("{}", Message(permit));
  }
  MESORIG_RETURN_IF_ERROR(machine_.Give(command, reason));
  if (command == SequencerCommand::kPauseNow || command == SequencerCommand::kAbort) {
    if (safety_.gate() != nullptr) safety_.gate()->Shut();
  }
  Emit(Kind::kState, reason);
  return OkStatus();
}

Status SequencerImpl::Stop(std::string_view reason) {
  const bool in_session = InSession(machine_.state());
  (void)machine_.Give(SequencerCommand::kStop, reason);  // every state knows it
  // Not left to the sequencer's thread: it may hang.
  const Status off = safety_.StopNow(reason);
  if (in_session) Emit(Kind::kState, reason);
  return off;
}

Status SequencerImpl::Acknowledge(uint32_t prompt_id) {
  MESORIG_RETURN_IF_ERROR(machine_.Check(SequencerCommand::kAcknowledge));
  return desk_.Acknowledge(prompt_id);
}

SequencerStatus SequencerImpl::GetStatus() const {
  SequencerStatus status;
  RigTime started{};
  std::shared_ptr<Session> session;
  clock_.Read([&] {
    status = status_;
    status.state = machine_.StateInsideChange();
    status.message = machine_.MessageInsideChange();
    started = run_started_;
    session = session_.lock();
  });
  status.now = clock_.Now();
  if (InSession(status.state) && started != RigTime{}) {
    status.rig_s = Seconds(status.now - started);
  }
  if (session && InSession(status.state)) status.storage = Message(session->Storage());
  if (session) {
    status.frames_queued = session->FramesQueued();
    status.frames_verified = session->FramesVerified();
  }
  status.trouble = board_.trouble();
  status.frames_durable = frames_durable_;
  status.deterministic = deterministic_();
  status.readings = board_.Get();
  if (status.state == SequencerState::kWaiting) status.prompt = desk_.current();
  return status;
}

void SequencerImpl::OnEvent(std::function<void(const SequencerEvent&)> listener) {
  const MutexLock lock(listener_mutex_);
  listener_ = std::move(listener);
}

void SequencerImpl::Emit(Kind kind, std::string_view text,
                         const std::function<void(SequencerEvent&)>& fill) {
  std::function<void(const SequencerEvent&)> listener;
  {
    const MutexLock lock(listener_mutex_);
    listener = listener_;
  }
  if (!listener) return;
  SequencerEvent event;
  event.kind = kind;
  event.status = GetStatus();
  event.text = text;
  if (fill) fill(event);
  listener(event);
}

void SequencerImpl::RefreshIdleReadings() {
  // A bank or line that does not answer shows by the age of its reading.
  const Status chain = chain_.Check();
  board_.SetChain(chain_.levels());
  // (A look: nobody's work, that would tell Safety and the bank that all is well.)
  const auto levels = devices_.lamps->Watch();
  if (levels.ok()) board_.SetLevels(levels->levels, clock_.Now());
  if (!chain.ok() || !levels.ok()) {
    Log("control").debug("idle: {} {}", Message(chain), Message(levels.status()));
  }
}

void SequencerImpl::Loop() {
  RefreshIdleReadings();
  for (;;) {
    const bool woken = clock_.WaitFor(kIdleRefresh, [&] { return closing_ || job_; });
    if (!woken) {
      RefreshIdleReadings();
      continue;
    }
    std::optional<SessionJob> job;
    clock_.Change([&] { job = std::exchange(job_, std::nullopt); });
    if (!job) return;
    RunJob(*job);
  }
}

bool SequencerImpl::AwaitStart(Status& why) {
  if (machine_.state() == SequencerState::kArmed) Emit(Kind::kState, "");
  clock_.WaitUntil(kNever, [&] { return machine_.StateInsideChange() != SequencerState::kArmed; });
  const RunOrder order = machine_.order();
  if (order != RunOrder::kStop && order != RunOrder::kAbort) return true;
  why = Cancelled("{}", machine_.message());
  return false;
}

void SequencerImpl::RunJob(const SessionJob& job) {
  Times times;
  Status run;
  finished_ = false;
  if (AwaitStart(run)) {
    Emit(Kind::kStarted, job.plan.name,
         [&](SequencerEvent& event) { event.resumed = job.resumed; });
    job.session->OnDurable([this](uint32_t frames) { frames_durable_ = frames; });
    run = RunInActivity(job, times);
  }
  if (!run.ok() && !finished_) EndIncomplete(job, run, times);
  job.session->OnDurable([](uint32_t) {});
  frames_durable_ = job.session->Summary().frames_durable;

  const bool by_hand = absl::IsCancelled(run);
  const SequencerState state = run.ok() || by_hand ? SequencerState::kIdle : SequencerState::kFault;
  const std::string text(run.ok() ? std::string_view("complete") : Message(run));
  clock_.Change([&] {
    status_.rig_s = times.virtual_s;
    session_.reset();
  });
  if (!run.ok()) Log("control").warn("session {}: incomplete: {}", job.session->id(), text);
  machine_.Rest(state, text);
  Emit(Kind::kState, text);
  Emit(Kind::kEnded, run.ok() ? "" : text, [&](SequencerEvent& event) {
    event.complete = run.ok();
    event.virtual_s = times.virtual_s;
    event.wall_s = times.wall_s;
    event.preparation_s = times.preparation_s;
  });
}

Status SequencerImpl::RunInActivity(const SessionJob& job, Times& times) {
  times.start = clock_.Now();
  times.wall_start = HostClock::now();
  // (Zero is "not yet": a simulation begins there.)
  clock_.Change([&] { run_started_ = std::max(times.start, RigTime(1)); });
  Status status;
  {
    RigClock::Activity activity(clock_, Pace::kFree);
    chain_.Arm();
    desk_.BeginSession();
    const RunContext context = MakeContext(job, activity, times);
    SessionRun run(context, job);
    status = run.Run();
    chain_.Disarm();
    times.preparation_s = run.preparation_s();
  }
  ReadClocks(times);
  return status;
}

void SequencerImpl::ReadClocks(Times& times) const {
  times.virtual_s = Seconds(clock_.Now() - times.start);
  times.wall_s = std::chrono::duration<double>(HostClock::now() - times.wall_start).count();
}

RunContext SequencerImpl::MakeContext(const SessionJob& job, RigClock::Activity& activity,
                                      Times& times) {
  Session& session = *job.session;
  return {clock_,
          rig_,
          devices_,
          safety_,
          chain_,
          safety_.gate(),
          desk_,
          activity,
          machine_,
          board_,
          job.plan,
          session,
          [this, &job](const RunProgress& progress) { OnProgress(job, progress); },
          [this, &session](const std::string& note) {
            Log("control").warn("{}", note);
            const Status status =
                session.Record({JournalKind::kNote, clock_.Now().count(), -1, 0, note});
            if (!status.ok()) Log("control").error("journal: {}", Message(status));
            Emit(Kind::kNote, note);
          },
          [this, &session, &times] {
            ReadClocks(times);
            const Status finished =
                session.Finish(true, "", times.virtual_s, times.wall_s, deterministic_());
            finished_ = finished.ok() || !absl::IsUnavailable(finished);
            return finished;
          },
          [this] { Emit(Kind::kState, machine_.message()); },
          [this](int camera, const std::string& text) {
            Log("control").warn("{}", text);
            clock_.Change([&] { ++status_.alarms; });
            Emit(Kind::kAlarm, text,
                 [&](SequencerEvent& event) { event.camera = rig_.cameras[camera].name; });
          },
          [this](bool waiting) { return OnWait(waiting); }};
}

void SequencerImpl::OnProgress(const SessionJob& job, const RunProgress& progress) {
  const double left =
      job.plan.shots == 0 ? 0 : 1 - static_cast<double>(progress.shots_done) / job.plan.shots;
  clock_.Change([&] {
    status_.shots_done = progress.shots_done;
    status_.frames = progress.frames;
    status_.bytes_left = progress.bytes_left;
    status_.remaining_s = job.plan.seconds * std::max(0.0, left);
  });
  Emit(Kind::kProgress, "");
}

bool SequencerImpl::OnWait(bool waiting) {
  const auto from = waiting ? SequencerState::kRunning : SequencerState::kWaiting;
  const auto to = waiting ? SequencerState::kWaiting : SequencerState::kRunning;
  const bool changed = machine_.Move(from, to, "");  // a command has the last word
  if (changed) Emit(Kind::kState, "");
  if (changed && waiting) Emit(Kind::kPrompt, "");
  return changed;
}

void SequencerImpl::EndIncomplete(const SessionJob& job, const Status& why, const Times& times) {
  // What came before the end is kept, whatever the end was.
  const Status flushed = job.session->Flush();
  if (!flushed.ok()) Log("control").error("session {}: {}", job.session->id(), Message(flushed));
  const Status finished =
      job.session->Finish(false, Message(why), times.virtual_s, times.wall_s, deterministic_());
  if (!finished.ok()) Log("control").error("session {}: {}", job.session->id(), Message(finished));
}

}  // namespace

std::unique_ptr<Sequencer> Sequencer::Create(RigClock& clock, const Rig& rig, Devices devices,
                                             std::function<bool()> deterministic,
                                             Safety* safety) {
  MESORIG_CHECK(devices.stop != nullptr && devices.lamps != nullptr);
  MESORIG_CHECK(devices.axes.size() == rig.axes.size());
  MESORIG_CHECK(devices.cameras.size() == rig.cameras.size());
  return std::make_unique<SequencerImpl>(clock, rig, std::move(devices), std::move(deterministic),
                                         safety);
}

}  // namespace mesorig::daemon
