#pragma once
// A whole rig in memory with its sequencer.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <functional>

#include "daemon/control/sequencer.h"
#include "tests/daemon/fakes/fake_devices.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/fake_session.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {

// A whole rig in memory with its sequencer.
class Bench {
 public:
  explicit Bench(Rig the_rig = SmallRig()) : rig(std::move(the_rig)) {
    for (const auto& axis : rig.axes) {
      axes.push_back(std::make_unique<FakeAxis>(clock, stop, log, axis));
      devices_.axes.push_back(axes.back().get());
    }
    for (const auto& camera : rig.cameras) {
      cameras.push_back(std::make_unique<FakeCamera>(clock, stop, log, camera));
      devices_.cameras.push_back(cameras.back().get());
    }
    devices_.lamps = &lamps;
    devices_.lines = &lines;
    devices_.stop = &stop;
    if (rig.laser) {
      lines.AddOneShot(rig.lines.laser_trigger, rig.lines.laser_on);
      laser = std::make_unique<FakeLaser>(clock, stop, log, *rig.laser);
      devices_.laser = laser.get();
    }
    sequencer = Sequencer::Create(clock, rig, devices_, [] { return true; });
    sequencer->OnEvent([this](const SequencerEvent& event) {
      std::lock_guard lock(mutex_);
      events.push_back(event);
      ended_.notify_all();
    });
  }
  Status Begin(const CompiledPlan& plan, SequencerCommand how = SequencerCommand::kRun) {
    session->Expect(plan);
    SessionJob job;
    job.plan = plan;
    job.session = session;
    job.resumed = how == SequencerCommand::kResume;
    job.accept_reference = accept_reference;
    return Begin(how, std::move(job));
  }
  Status Begin(SequencerCommand how, SessionJob job) {
    const Status status = sequencer->Begin(how, std::move(job));
    std::lock_guard lock(mutex_);
    begun_ += status.ok();
    return status;
  }
  // Until nothing happens by itself any more.
  SequencerState AwaitStable() {
    SequencerState state{};
    AwaitTrue([&] {
      state = sequencer->GetStatus().state;
      if (!InSession(state)) return Count(SequencerEvent::Kind::kEnded) == begun_;
      return RowOf(state).off;
    });
    return state;
  }
  // Runs the plan to its end.
  SequencerEvent Run(const CompiledPlan& plan, SequencerCommand how = SequencerCommand::kRun) {
    const size_t before = Ends();
    EXPECT_EQ(Begin(plan, how), OkStatus());
    return AwaitEnd(before);
  }
  // Of sessions that ended so far.
  size_t Ends() const {
    std::lock_guard lock(mutex_);
    return Count(SequencerEvent::Kind::kEnded);
  }
  SequencerEvent AwaitEnd(size_t before = 0) {
    std::unique_lock lock(mutex_);
    ended_.wait(lock, [&] { return Count(SequencerEvent::Kind::kEnded) > before; });
    for (auto event = events.rbegin();; ++event) {
      if (event->kind == SequencerEvent::Kind::kEnded) return *event;
    }
  }
  // Until the sequencer says that it is in this state.
  void AwaitState(SequencerState state) {
    AwaitTrue([&] { return sequencer->GetStatus().state == state; });
  }
  // Looks again at each event.
  void AwaitTrue(const std::function<bool()>& what) {
    std::unique_lock lock(mutex_);
    ended_.wait(lock, what);
  }
  // Until the listener has seen such an event (there may be one already).
  void AwaitEvent(SequencerEvent::Kind kind, size_t count = 1) {
    std::unique_lock lock(mutex_);
    ended_.wait(lock, [&] { return Count(kind) >= count; });
  }
  // At the rig: what opened the chain is cleared by nothing else.
  void PressReset() {
    lines.Set(rig.lines.reset, false);
    lines.Set(rig.lines.reset, true);
  }
  void ExpectAtRest() {
    EXPECT_FALSE(lamps.anything_on());
    EXPECT_FALSE(laser && laser->moving());
    for (const auto& axis : axes) {
      EXPECT_FALSE(axis->Read().moving) << axis->name();
      EXPECT_FALSE(axis->Read().enabled) << axis->name();
    }
  }
  void ExpectIncomplete(std::string_view reason) {
    EXPECT_EQ(session->finishes(), 1);
    EXPECT_EQ(session->Summary().end, SessionEnd::kIncomplete);
    EXPECT_THAT(session->Summary().reason, ::testing::HasSubstr(std::string(reason)));
  }

  // What the devices were asked so far.
  int operations() const { return static_cast<int>(log.operations().size()); }

  FakeRigClock clock;
  StopFlag stop{clock};
  const Rig rig;
  OperationLog log;
  std::vector<std::unique_ptr<FakeAxis>> axes;
  std::vector<std::unique_ptr<FakeCamera>> cameras;
  FakeLampBank lamps{clock, log, rig};
  FakeLines lines{clock};
  std::unique_ptr<FakeLaser> laser;  // in a rig with one
  std::shared_ptr<FakeSession> session = std::make_shared<FakeSession>();
  std::vector<SequencerEvent> events;
  bool accept_reference = false;
  std::unique_ptr<Sequencer> sequencer;

 private:
  size_t Count(SequencerEvent::Kind kind) const {
    return std::count_if(events.begin(), events.end(),
                         [&](const SequencerEvent& event) { return event.kind == kind; });
  }
  Devices devices_;
  size_t begun_ = 0;
  mutable std::mutex mutex_;
  std::condition_variable ended_;
};

// How many operations the small plan takes when nothing disturbs it.
inline int OperationsOfSmallPlan() {
  Bench whole;
  EXPECT_TRUE(whole.Run(SmallPlan(whole.rig)).complete);
  return whole.operations();
}

}  // namespace mesorig::daemon
