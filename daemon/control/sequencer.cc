#include "daemon/control/sequencer.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <utility>

#include "daemon/control/plan_run.h"
#include "daemon/control/reading_board.h"
#include "daemon/device/rig_thread.h"
#include "protocol/base/check.h"
#include "protocol/base/log.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;

bool Runs(SequencerState state) {
  return state == SequencerState::kRunning || state == SequencerState::kWaiting ||
         state == SequencerState::kStopping;
}

constexpr RigTime kIdleRefresh{1'000'000'000};

class SequencerImpl final : public Sequencer {
 public:
  SequencerImpl(RigClock& clock, const Rig& rig, Devices devices,
                std::function<bool()> deterministic);
  ~SequencerImpl() override;
  Status Start(CompiledPlan plan, std::shared_ptr<Session> session) override;
  Status Stop(std::string_view reason) override;
  Status Acknowledge(uint32_t prompt_id) override { return desk_.Acknowledge(prompt_id); }
  SequencerStatus GetStatus() const override;
  void OnEvent(std::function<void(const SequencerEvent&)> listener) override;

 private:
  struct Job {
    CompiledPlan plan;
    std::shared_ptr<Session> session;  // shared with those who read it while it grows
  };
  struct Times {
    RigTime rig_start{};
    HostClock::time_point wall_start;
    double virtual_s = 0, wall_s = 0;
  };
  void Loop();
  void RunJob(const Job& job);
  Status RunInActivity(const Job& job, Times& times);
  Status EndSession(const Job& job, const Status& run, const Times& times);
  void SetState(SequencerState state, std::string_view message);
  void Emit(SequencerEvent::Kind kind, std::string_view text,
            const std::function<void(SequencerEvent&)>& fill = nullptr);
  void OnWait(bool waiting);
  void RefreshIdleReadings();

  RigClock& clock_;
  const Rig& rig_;
  const Devices devices_;
  const std::function<bool()> deterministic_;
  InterlockChain chain_;
  std::optional<LaserGate> gate_;  // in a rig with a laser
  OperatorDesk desk_;
  ReadingBoard board_;
  std::atomic<uint32_t> frames_durable_{0};
  // Guarded by the clock's lock:
  std::optional<Job> job_;
  bool closing_ = false;
  SequencerStatus status_;
  RigTime run_started_{};

  mutable Mutex listener_mutex_;
  std::function<void(const SequencerEvent&)> listener_ GUARDED_BY(listener_mutex_);
  RigThread thread_;
};

SequencerImpl::SequencerImpl(RigClock& clock, const Rig& rig, Devices devices,
                             std::function<bool()> deterministic)
    : clock_(clock),
      rig_(rig),
      devices_(std::move(devices)),
      deterministic_(std::move(deterministic)),
      chain_(clock, devices_.lines, rig.lines, *devices_.stop),
      desk_(clock, chain_, *devices_.stop),
      board_(rig),
      thread_(clock, "sequencer", [this] { Loop(); }) {
  // (Before the first plan: nobody else has this object yet.)
  if (rig.laser) gate_.emplace(clock, devices_.lines, rig.lines, *devices_.stop);
}

SequencerImpl::~SequencerImpl() {
  if (const Status status = Stop("the daemon ends"); !status.ok()) {
    spdlog::error("{}", Message(status));
  }
  clock_.Change([&] { closing_ = true; });
}

Status SequencerImpl::Start(CompiledPlan plan, std::shared_ptr<Session> session) {
  const auto busy = [&] { return job_ || Runs(status_.state); };
  Status refusal;
  const auto refuse_when_busy = [&] {
    if (busy()) {
      refusal = FailedPrecondition("session {} is running: stop it or wait for its end",
                                   status_.session_id);
    }
  };
  clock_.Read(refuse_when_busy);
  MESORIG_RETURN_IF_ERROR(refusal);
  if (plan.rig_sha256 != rig_.sha256) {
    return InvalidArgument("plan {} was compiled for a rig with SHA-256 {}, this one has {}",
                           plan.name, plan.rig_sha256, rig_.sha256);
  }
  MESORIG_RETURN_IF_ERROR(chain_.Check());
  board_.SetChain(chain_.levels());
  clock_.Change([&] {
    refuse_when_busy();
    if (!refusal.ok() || closing_) return;
    SequencerStatus fresh;
    fresh.state = SequencerState::kRunning;
    fresh.session_id = session->id();
    fresh.shots = plan.shots;
    fresh.estimated_s = plan.seconds;
    status_ = std::move(fresh);
    run_started_ = {};
    frames_durable_ = 0;
    devices_.stop->LowerInsideChange();
    job_ = Job{std::move(plan), std::move(session)};
  });
  return refusal;
}

Status SequencerImpl::Stop(std::string_view reason) {
  clock_.Change([&] {
    if (!Runs(status_.state) || status_.state == SequencerState::kStopping) return;
    status_.state = SequencerState::kStopping;
    status_.message = reason;
    devices_.stop->RaiseInsideChange(reason);
  });
  // Not left to the sequencer's thread: it may hang.
  if (gate_) gate_->Shut();
  return devices_.lamps->AllOff();
}

SequencerStatus SequencerImpl::GetStatus() const {
  SequencerStatus status;
  RigTime started{};
  clock_.Read([&] {
    status = status_;
    started = run_started_;
  });
  status.now = clock_.Now();
  if (Runs(status.state) && started != RigTime{}) status.rig_s = Seconds(status.now - started);
  status.frames_durable = frames_durable_;
  status.deterministic = deterministic_();
  status.readings = board_.Get();
  status.prompt = desk_.current();
  return status;
}

void SequencerImpl::OnEvent(std::function<void(const SequencerEvent&)> listener) {
  const MutexLock lock(listener_mutex_);
  listener_ = std::move(listener);
}

void SequencerImpl::Emit(SequencerEvent::Kind kind, std::string_view text,
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

void SequencerImpl::SetState(SequencerState state, std::string_view message) {
  clock_.Change([&] {
    status_.state = state;
    status_.message = message;
  });
  Emit(SequencerEvent::Kind::kState, message);
}

void SequencerImpl::RefreshIdleReadings() {
  // A bank or line that does not answer shows by the age of its reading.
  const Status chain = chain_.Check();
  board_.SetChain(chain_.levels());
  const auto levels = devices_.lamps->ReadLevels();
  if (levels.ok()) board_.SetLevels(*levels, clock_.Now());
  if (!chain.ok() || !levels.ok()) {
    spdlog::debug("idle: {} {}", Message(chain), Message(levels.status()));
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
    std::optional<Job> job;
    clock_.Change([&] { job = std::exchange(job_, std::nullopt); });
    if (!job) return;
    RunJob(*job);
  }
}

void SequencerImpl::RunJob(const Job& job) {
  Emit(SequencerEvent::Kind::kStarted, job.plan.name);
  job.session->OnDurable([this](uint32_t frames) { frames_durable_ = frames; });
  Times times;
  const Status run = RunInActivity(job, times);
  const Status end = EndSession(job, run, times);
  job.session->OnDurable([](uint32_t) {});
  frames_durable_ = job.session->Summary().frames_durable;

  const bool by_hand = absl::IsCancelled(run) && chain_.Opening().ok();
  const SequencerState state = end.ok() || by_hand ? SequencerState::kIdle : SequencerState::kFault;
  clock_.Change([&] { status_.rig_s = times.virtual_s; });
  if (!end.ok()) spdlog::warn("session {}: incomplete: {}", job.session->id(), Message(end));
  SetState(state, end.ok() ? std::string_view("complete") : Message(end));
  Emit(SequencerEvent::Kind::kEnded, Message(end), [&](SequencerEvent& event) {
    event.complete = end.ok();
    event.virtual_s = times.virtual_s;
    event.wall_s = times.wall_s;
  });
}

Status SequencerImpl::RunInActivity(const Job& job, Times& times) {
  const RigTime start = clock_.Now();
  const auto wall_start = HostClock::now();
  clock_.Change([&] { run_started_ = start; });
  Status status;
  {
    RigClock::Activity activity(clock_, Pace::kFree);
    chain_.Arm();
    desk_.BeginSession();
    const PlanRun::Context context{clock_,
                                   rig_,
                                   devices_,
                                   chain_,
                                   gate_ ? &*gate_ : nullptr,
                                   desk_,
                                   activity,
                                   board_,
                                   [this](const RunProgress& progress) {
                                     clock_.Change([&] {
                                       status_.shots_done = progress.shots_done;
                                       status_.frames = progress.frames;
                                     });
                                     Emit(SequencerEvent::Kind::kProgress, "");
                                   },
                                   [this](const std::string& note) {
                                     spdlog::warn("{}", note);
                                     Emit(SequencerEvent::Kind::kNote, note);
                                   },
                                   [this](bool waiting) { OnWait(waiting); }};
    PlanRun run(context, job.plan, *job.session);
    status = run.Run();
    if (!status.ok()) {
      run.MakeSafe();
      // A switch-off may have overtaken what the run was doing: say why it came.
      if (const Status stop = devices_.stop->Check(); !stop.ok()) status = stop;
      // An open chain cuts torque and lamps: what the devices then report is not the reason.
      if (!absl::IsCancelled(status)) (void)chain_.Check();
      // Of a stop and an opening the one that came first is the reason.
      const Status opening = chain_.Opening();
      if (!opening.ok() && (!absl::IsCancelled(status) || Message(status) == Message(opening))) {
        status = opening;
      }
    }
    chain_.Disarm();
  }
  times.virtual_s = Seconds(clock_.Now() - start);
  times.wall_s = std::chrono::duration<double>(HostClock::now() - wall_start).count();
  return status;
}

void SequencerImpl::OnWait(bool waiting) {
  bool changed = false;
  clock_.Change([&] {
    const auto from = waiting ? SequencerState::kRunning : SequencerState::kWaiting;
    changed = status_.state == from;  // a stop has the last word
    if (changed) status_.state = waiting ? SequencerState::kWaiting : SequencerState::kRunning;
  });
  if (changed) Emit(SequencerEvent::Kind::kState, "");
  if (waiting) Emit(SequencerEvent::Kind::kPrompt, "");
}

Status SequencerImpl::EndSession(const Job& job, const Status& run, const Times& times) {
  Status status = run;
  // What came before the end is kept, whatever the end was.
  const Status flushed = job.session->Flush();
  if (status.ok()) status = flushed;
  const Status finished = job.session->Finish(status.ok(), Message(status), times.virtual_s,
                                              times.wall_s, deterministic_());
  if (!finished.ok()) spdlog::error("session {}: {}", job.session->id(), Message(finished));
  return status.ok() ? finished : status;
}

}  // namespace

std::unique_ptr<Sequencer> Sequencer::Create(RigClock& clock, const Rig& rig, Devices devices,
                                             std::function<bool()> deterministic) {
  MESORIG_CHECK(devices.stop != nullptr && devices.lamps != nullptr);
  MESORIG_CHECK(devices.axes.size() == rig.axes.size());
  MESORIG_CHECK(devices.cameras.size() == rig.cameras.size());
  return std::make_unique<SequencerImpl>(clock, rig, std::move(devices), std::move(deterministic));
}

}  // namespace mesorig::daemon
