#include "tests/daemon/faults/fault_bench.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>

#include "daemon/session/session.h"
#include "protocol/base/digest.h"
#include "tests/daemon/fakes/sim_bench.h"

namespace mesorig::daemon {
namespace {

// Longer than every watch of the rig's own: lamps' communication loss, drives' heartbeat.
constexpr RigTime kRigWatches = std::chrono::seconds(4);

class FaultBench : private SimBench {
 public:
  explicit FaultBench(FaultScript script) : SimBench(std::move(script)) {
    sequencer->OnEvent([this](const SequencerEvent& event) { Hear(event); });
  }
  ~FaultBench() { sequencer.reset(); }
  FaultOutcome Run(const std::filesystem::path& root) {
    const CompiledPlan plan = SmallPlan(rig);
    auto session = Session::Create(root, plan, rig).value();
    const std::string id = session->id();
    EXPECT_EQ(sequencer->Begin(SequencerCommand::kRun, {plan, session}), OkStatus());
    FaultOutcome outcome;
    {
      std::unique_lock lock(mutex_);
      ended_.wait(lock, [&] { return end_event_.has_value(); });
      outcome.complete = end_event_->complete;
      outcome.reason = end_event_->text;
      outcome.virtual_s = end_event_->virtual_s;
      outcome.recoveries = recoveries_;
    }
    const uint32_t acknowledged = session->Summary().frames_durable;
    session.reset();
    ReadBack(root, id, acknowledged, outcome);
    outcome.still_on = StillOn();
    return outcome;
  }

 private:
  void Hear(const SequencerEvent& event) {
    std::lock_guard lock(mutex_);
    if (event.kind == SequencerEvent::Kind::kNote &&
        event.text.find("trying again in") != std::string::npos) {
      ++recoveries_;
    }
    if (event.kind != SequencerEvent::Kind::kEnded) return;
    end_event_ = event;
    ended_.notify_all();
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
    });
    return on;
  }

  std::mutex mutex_;
  std::condition_variable ended_;
  std::optional<SequencerEvent> end_event_;
  int recoveries_ = 0;
};

}  // namespace

FaultOutcome RunUnderFaults(const std::filesystem::path& root, FaultScript script) {
  return FaultBench(std::move(script)).Run(root);
}

}  // namespace mesorig::daemon
