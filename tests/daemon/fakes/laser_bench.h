#pragma once
// The bench of the small rig with a laser, and its operator.

#include <atomic>
#include <thread>
#include <vector>

#include "tests/daemon/fakes/bench.h"

namespace mesorig::daemon {

// A bench whose operator answers each prompt at once, completely.
class LaserBench : public Bench {
 public:
  LaserBench() : Bench(SmallLaserRig()) {}
  void Visit() {
    lines.Set(rig.lines.door, false);
    lines.Set(rig.lines.door, true);
    lines.Set(rig.lines.reset, false);
    lines.Set(rig.lines.reset, true);
  }
  SequencerEvent RunWithOperator(const CompiledPlan& plan,
                                 SequencerCommand how = SequencerCommand::kRun) {
    done_ = false;
    std::thread operator_thread([&] {
      while (!done_) {
        const auto prompt = sequencer->GetStatus().prompt;
        if (prompt && !prompt->acknowledged &&
            (prompts.empty() || prompts.back().id != prompt->id)) {
          prompts.push_back(*prompt);
          Visit();
          (void)sequencer->Acknowledge(prompt->id);
        }
        std::this_thread::yield();
      }
    });
    const SequencerEvent end = Run(plan, how);
    done_ = true;
    operator_thread.join();
    return end;
  }
  void LetTimePass(double seconds) {
    const RigClock::Member member(clock, "test");
    const RigClock::Activity activity(clock, Pace::kFree);
    clock.SleepFor(FromSeconds(seconds));
  }
  std::vector<OperatorPrompt> prompts;

 private:
  std::atomic<bool> done_{false};
};

}  // namespace mesorig::daemon
