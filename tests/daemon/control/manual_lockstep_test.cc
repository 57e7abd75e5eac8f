// Hold to run on the real driver and the simulator's drive, at the pace of the wall clock.

#include <gtest/gtest.h>

#include <algorithm>

#include "daemon/control/manual_control.h"
#include "daemon/device/rig_thread.h"
#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;

// A client repeats its jog every 50 ms of rig time and falls silent: the drive stands still 200 ms,
// a round of the bus and its braking later.
TEST(ManualLockstep, AJogEndsOnTheDrive) {
  const Rig rig = SmallRig();
  SimRig sim(rig);
  RigEnd end(sim, rig);
  std::vector<std::unique_ptr<Axis>> axes;
  ManualDevices devices;
  for (size_t i = 0; i < rig.axes.size(); ++i) {
    axes.push_back(MakeAxis("cia402", end.context, static_cast<int>(i)).value());
    devices.axes.push_back(axes.back().get());
  }
  const auto lamps = MakeLampBank("modbus_lamps", end.context).value();
  devices.lamps = lamps.get();
  devices.stop = &end.stop;
  devices.may_energise = [] { return OkStatus(); };
  RigThread(*end.link, "homing", [&] {
    const RigClock::Activity activity(*end.link, Pace::kFree);
    ASSERT_EQ(axes[0]->Enable(), OkStatus());
    ASSERT_EQ(axes[0]->StartHoming(), OkStatus());
    ASSERT_EQ(axes[0]->AwaitHoming(end.link->Now() + std::chrono::seconds(60)), OkStatus());
    ASSERT_EQ(axes[0]->Disable(), OkStatus());
  });
  const auto counts = [&](RigTime* now = nullptr) {
    double at = 0;
    sim.Exclusive([&](RigTime t) {
      at = sim.can.node(0).WorldCounts(t);
      if (now != nullptr) *now = t;
    });
    return at / rig.axes[0].counts_per_turn * 360;
  };
  ASSERT_NEAR(counts(), 0, 0.01);
  const auto manual = ManualControl::Create(*end.link, rig, devices);
  manual->Admit(1);
  RigTime silent{}, stood{};
  double last = -1;
  RigThread(*end.link, "client", [&] {
    for (int i = 0; i < 8; ++i) {
      EXPECT_EQ(manual->Jog(1, 0, RadFromDeg(20)), OkStatus());
      silent = end.link->Now();
      end.link->SleepFor(milliseconds(50));
    }
    EXPECT_GT(counts(), 1) << "it moves";
    for (int i = 0; i < 150; ++i) {  // while it brakes, and after
      const double at = counts();
      if (at != last) stood = end.link->Now();
      last = at;
      end.link->SleepFor(milliseconds(5));
    }
  });
  const double after_s = Seconds(stood - silent);
  // 200 ms; braking from 20 deg/s at 180 deg/s^2 takes 111 ms at most.
  EXPECT_GT(after_s, 0.2);
  EXPECT_LT(after_s, 0.36);
  EXPECT_LT(last, 20 * (0.35 + 0.36));
  RecordProperty("stood_after_ms", std::to_string(after_s * 1e3));
  printf("jog: silent, stands after %.1f ms at %.3f deg\n", after_s * 1e3, last);

  manual->Close(1, "over");
  EXPECT_EQ(manual->AwaitRest(10), OkStatus());
  sim.Exclusive([&](RigTime) { EXPECT_FALSE(sim.can.node(0).torque_on()); });
}

}  // namespace
}  // namespace mesorig::daemon
