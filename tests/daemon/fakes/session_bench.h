#pragma once
// Sessions in memory, run by the real sequencer and drivers on the simulator's devices.

#include <gtest/gtest.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "tests/daemon/fakes/fake_session.h"
#include "tests/daemon/fakes/sim_bench.h"

namespace mesorig::daemon {

class SessionBench : public SimBench {
 public:
  explicit SessionBench(std::vector<sim_wire::TimedInjection> script = {},
                        Rig description = SmallRig())
      : SimBench(std::move(script), std::move(description)) {
    sequencer->OnEvent([this](const SequencerEvent& event) {
      std::lock_guard lock(mutex_);
      if (event.kind != SequencerEvent::Kind::kEnded) return;
      ended_ = event;
      condition_.notify_all();
    });
  }
  ~SessionBench() { sequencer.reset(); }
  // To its end.
  SequencerEvent Run(const CompiledPlan& plan, SequencerCommand how = SequencerCommand::kRun) {
    session->Expect(plan);
    SessionJob job{plan, session};
    job.resumed = how == SequencerCommand::kResume;
    const Status begun = sequencer->Begin(how, std::move(job));
    EXPECT_EQ(begun, OkStatus());
    if (!begun.ok()) return {};
    std::unique_lock lock(mutex_);
    condition_.wait(lock, [&] { return ended_.has_value(); });
    return *std::exchange(ended_, std::nullopt);
  }
  // Virtual time, which stands still between sessions.
  void Pass(double seconds) {
    const RigClock::Member member(*end.link, "test");
    const RigClock::Activity activity(*end.link, Pace::kFree);
    end.link->SleepFor(FromSeconds(seconds));
  }
  // By the simulator's own state.
  void ExpectAtRest() {
    sim.Exclusive([&](RigTime now) {
      for (const double level : sim.lamps.CommandedLevels()) EXPECT_EQ(level, 0);
      for (size_t i = 0; i < rig.axes.size(); ++i) {
        EXPECT_FALSE(sim.can.node(i).torque_on()) << i;
        EXPECT_FALSE(sim.can.node(i).Moving(now)) << i;
      }
    });
  }

  std::shared_ptr<FakeSession> session = std::make_shared<FakeSession>();

 private:
  std::mutex mutex_;
  std::condition_variable condition_;
  std::optional<SequencerEvent> ended_;
};

}  // namespace mesorig::daemon
