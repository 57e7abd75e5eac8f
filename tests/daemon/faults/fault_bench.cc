#include "tests/daemon/faults/fault_bench.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>
#include <thread>

#include "daemon/session/session.h"
#include "protocol/base/digest.h"
#include "tests/daemon/fakes/sim_bench.h"

namespace mesorig::daemon {
namespace {

// Longer than every watch of the rig's own: lamps' communication loss, drives' heartbeat.
constexpr RigTime kRigWatches = std::chrono::seconds(4);

// The small rig's real motor does 3.75 deg/s.
CompiledPlan SlowSweeps(const Rig& rig) {
  CompiledPlan plan = SmallLaserPlan(rig);
  for (Step& step : plan.steps) {
    step.sweep.tilt_from_rad *= 0.2;
    step.sweep.tilt_to_rad *= 0.2;
  }
  return plan;
}

class FaultBench : private SimBench {
 public:
  FaultBench(FaultScript script, FaultedPlan plan)
      : SimBench(std::move(script), plan == FaultedPlan::kSweeps ? SmallLaserRig() : SmallRig()) {
    sequencer->OnEvent([this](const SequencerEvent& event) { Hear(event); });
  }
  ~FaultBench() { sequencer.reset(); }
  FaultOutcome Run(const std::filesystem::path& root) {
    const CompiledPlan plan = rig.laser ? SlowSweeps(rig) : SmallPlan(rig);
    std::thread hands([this] { ServePrompts(); });
    auto session = Session::Create(root, plan, rig).value();
    const std::string id = session->id();
    EXPECT_EQ(sequencer->Begin(SequencerCommand::kRun, {plan, session}), OkStatus());
    FaultOutcome outcome;
    {
      std::unique_lock lock(mutex_);
      heard_.wait(lock, [&] { return end_event_.has_value(); });
      outcome.complete = end_event_->complete;
      outcome.reason = end_event_->text;
      outcome.virtual_s = end_event_->virtual_s;
      outcome.recoveries = recoveries_;
    }
    hands.join();
    const uint32_t acknowledged = session->Summary().frames_durable;
    session.reset();
    ReadBack(root, id, acknowledged, outcome);
    outcome.still_on = StillOn();
    return outcome;
  }

 private:
  // The operator, until the session ends.
  void ServePrompts() {
    for (uint32_t answered = 0;;) {
      {
        std::unique_lock lock(mutex_);
        heard_.wait(lock, [&] { return end_event_.has_value() || prompts_ > answered; });
        if (end_event_) return;
        answered = prompts_;
      }
      const auto prompt = sequencer->GetStatus().prompt;
      if (!prompt) continue;
      for (const std::string& hand : {std::string("lines door open"), "nxt mount " + prompt->mount,
                                      std::string("lines door close"), std::string("lines reset")}) {
        EXPECT_EQ(sim.Inject(hand), OkStatus()) << hand;
      }
      EXPECT_EQ(sequencer->Acknowledge(prompt->id), OkStatus());
    }
  }
  void Hear(const SequencerEvent& event) {
    std::lock_guard lock(mutex_);
    if (event.kind == SequencerEvent::Kind::kPrompt) ++prompts_;
    if (event.kind == SequencerEvent::Kind::kNote &&
        event.text.find("trying again in") != std::string::npos) {
      ++recoveries_;
    }
    if (event.kind == SequencerEvent::Kind::kEnded) end_event_ = event;
    heard_.notify_all();
  }
  void ReadBack(const std::filesystem::path& root, const std::string& id, uint32_t acknowledged,
                FaultOutcome& outcome) {
    auto stored = Session::Open(root, id);
    if (!stored.ok()) {
      outcome.damage = Message(stored.status());
      return;
    }
    uint32_t frames = 0;
    for (size_t camera = 0; camera < rig.cameras.size(); ++camera) {
      for (uint64_t cursor = 0;;) {
        const auto next = (*stored)->Next(static_cast<int>(camera), cursor, 0);
        if (!next.ok()) outcome.damage = Message(next.status());
        if (!next.ok() || !*next) break;
        cursor = (*next)->record.sequence;
        ++frames;
        const std::string digest = FrameDigest(*(*next)->pixels);
        if (digest != (*next)->record.digest) outcome.damage = "a digest is another one";
        outcome.live[{static_cast<int>(camera), (*next)->record.shot}] = digest;
      }
    }
    if (outcome.damage.empty() && outcome.live.size() < acknowledged) {
      outcome.damage =
          fmt::format("{} of {} acknowledged frames", outcome.live.size(), acknowledged);
    }
    if (outcome.complete && (*stored)->Summary().end != SessionEnd::kComplete) {
      outcome.damage = "told complete, stored otherwise";
    }
  }
  std::string StillOn() {
    {
      RigClock::Member member(*end.link, "test");
      RigClock::Activity activity(*end.link, Pace::kFree);
      end.link->SleepFor(kRigWatches);
    }
    std::string on;
    sim.Exclusive([&](RigTime now) {
      const auto levels = sim.lamps.CommandedLevels();
      for (size_t i = 0; i < levels.size(); ++i) {
        if (levels[i] > 0 || sim.lamps.Coil(rig.lamps[i].channel)) on += rig.lamps[i].name + " ";
      }
      for (size_t i = 0; i < rig.axes.size(); ++i) {
        const bool moves = sim.can.node(i).Moving(now);
        if (sim.can.node(i).torque_on() || moves) on += rig.axes[i].name + " ";
      }
      if (sim.laser && sim.laser->Shines(now)) on += "laser ";
    });
    return on;
  }

  std::mutex mutex_;
  std::condition_variable heard_;
  std::optional<SequencerEvent> end_event_;
  int recoveries_ = 0;
  uint32_t prompts_ = 0;
};

}  // namespace

FaultOutcome RunUnderFaults(const std::filesystem::path& root, FaultScript script,
                            FaultedPlan plan) {
  return FaultBench(std::move(script), plan).Run(root);
}

}  // namespace mesorig::daemon
