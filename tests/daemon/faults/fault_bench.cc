#include "tests/daemon/faults/fault_bench.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>

#include "daemon/control/sequencer.h"
#include "daemon/session/session.h"
#include "protocol/base/digest.h"
#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

// Longer than every watch of the rig's own: lamps' communication loss, drives' heartbeat.
constexpr RigTime kRigWatches = std::chrono::seconds(4);

// Simulator, drivers and sequencer.
class FaultBench {
 public:
  explicit FaultBench(FaultScript script) : sim_(rig_, std::move(script)) {
    for (size_t i = 0; i < rig_.axes.size(); ++i) {
      axes_.push_back(MakeAxis("cia402", end_.context, static_cast<int>(i)).value());
      devices_.axes.push_back(axes_.back().get());
    }
    for (size_t i = 0; i < rig_.cameras.size(); ++i) {
      cameras_.push_back(MakeCamera("sim_camera", end_.context, static_cast<int>(i)).value());
      devices_.cameras.push_back(cameras_.back().get());
    }
    lamps_ = MakeLampBank("modbus_lamps", end_.context).value();
    lines_ = MakeDigitalLines("gpio_lines", end_.context).value();
    devices_.lamps = lamps_.get();
    devices_.lines = lines_.get();
    devices_.stop = &end_.stop;
    sequencer_ = Sequencer::Create(*end_.link, rig_, devices_, [] { return true; });
    sequencer_->OnEvent([this](const SequencerEvent& event) { Hear(event); });
  }
  FaultOutcome Run(const std::filesystem::path& root) {
    const CompiledPlan plan = SmallPlan(rig_);
    auto session = Session::Create(root, plan, rig_).value();
    const std::string id = session->id();
    EXPECT_EQ(sequencer_->Begin(SequencerCommand::kRun, {plan, session}), OkStatus());
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
    for (size_t camera = 0; camera < rig_.cameras.size(); ++camera) {
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
      RigClock::Member member(*end_.link, "test");
      RigClock::Activity activity(*end_.link, Pace::kFree);
      end_.link->SleepFor(kRigWatches);
    }
    std::string on;
    sim_.Exclusive([&](RigTime now) {
      const auto levels = sim_.lamps.CommandedLevels();
      for (size_t i = 0; i < levels.size(); ++i) {
        if (levels[i] > 0 || sim_.lamps.Coil(rig_.lamps[i].channel)) on += rig_.lamps[i].name + " ";
      }
      for (size_t i = 0; i < rig_.axes.size(); ++i) {
        const bool moves = sim_.can.node(i).Moving(now);
        if (sim_.can.node(i).torque_on() || moves) on += rig_.axes[i].name + " ";
      }
    });
    return on;
  }

  const Rig rig_ = SmallRig();
  SimRig sim_;
  RigEnd end_{sim_, rig_};
  Devices devices_;
  std::vector<std::unique_ptr<Axis>> axes_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::unique_ptr<LampBank> lamps_;
  std::unique_ptr<DigitalLines> lines_;
  std::mutex mutex_;
  std::condition_variable ended_;
  std::optional<SequencerEvent> end_event_;
  int recoveries_ = 0;
  std::unique_ptr<Sequencer> sequencer_;
};

}  // namespace

FaultOutcome RunUnderFaults(const std::filesystem::path& root, FaultScript script) {
  return FaultBench(std::move(script)).Run(root);
}

}  // namespace mesorig::daemon
