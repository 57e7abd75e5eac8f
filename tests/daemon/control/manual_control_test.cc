// The rig by hand in virtual time: the fence at every command, hold to run, everything off at the
// end of a lease.

#include "daemon/control/manual_control.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "daemon/device/rig_thread.h"
#include "tests/daemon/fakes/fake_devices.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr RigTime kMs{1'000'000};

std::string Text(const Status& status) { return std::string(Message(status)); }

struct Hand {
  // guarded: by the rig's Safety, as in the daemon.
  explicit Hand(Rig the_rig = SmallRig(), bool guarded = false) : rig(std::move(the_rig)) {
    ManualDevices devices;
    for (const auto& axis : rig.axes) {
      axes.push_back(std::make_unique<FakeAxis>(clock, stop, log, axis));
      devices.axes.push_back(axes.back().get());
    }
    devices.lamps = &lamps;
    if (rig.laser) lines.AddOneShot(rig.lines.laser_trigger, rig.lines.laser_on);
    if (rig.laser && !guarded) {
      gate = std::make_unique<LaserGate>(clock, &lines, rig.lines, stop);
      devices.gate = gate.get();
    }
    devices.stop = &stop;
    devices.may_energise = [this] {
      return forbidden ? FailedPrecondition("the chain is open: door") : OkStatus();
    };
    if (guarded) Guard(devices);
    manual = ManualControl::Create(clock, rig, devices);
    manual->OnNote([this](const std::string& note) { notes.push_back(note); });
  }
  void Guard(ManualDevices& devices) {
    safety = std::make_unique<Safety>(clock, rig, SafetyDevices{devices.axes, &lamps, &lines}, stop);
    devices.axes = safety->axes();
    devices.lamps = safety->lamps();
    devices.gate = safety->gate();
    devices.may_energise = [this] { return safety->MayEnergise(); };
    devices.alive = [this] { safety->Alive(); };
    devices.safety = safety.get();
  }
  // Does `what` on a member of the clock, and waits for its end.
  void AsMember(const std::function<void()>& what) {
    RigThread client(clock, "client", [&] {
      const RigClock::Activity activity(clock, Pace::kFree);
      what();
    });
  }
  std::vector<std::string> Said() const { return log.operations(); }
  void ExpectOff() {
    EXPECT_EQ(manual->AwaitRest(20), OkStatus());
    EXPECT_FALSE(lamps.anything_on());
    for (const auto& axis : axes) {
      EXPECT_FALSE(axis->Read().enabled) << axis->name();
      EXPECT_FALSE(axis->Read().moving) << axis->name();
    }
  }

  FakeRigClock clock;
  StopFlag stop{clock};
  const Rig rig;
  OperationLog log;
  std::vector<std::unique_ptr<FakeAxis>> axes;
  FakeLampBank lamps{clock, log, rig};
  FakeLines lines{clock};
  std::unique_ptr<LaserGate> gate;
  std::atomic<bool> forbidden{false};
  std::unique_ptr<Safety> safety;
  std::vector<std::string> notes;  // of the manual thread: to be read at rest
  std::unique_ptr<ManualControl> manual;
};

TEST(ManualControl, NothingWithoutALease) {
  Hand hand;
  EXPECT_TRUE(absl::IsFailedPrecondition(hand.manual->Home(0, 0).get()));
  EXPECT_TRUE(absl::IsFailedPrecondition(hand.manual->MoveTo(1, 0, 0.1).get()));
  EXPECT_TRUE(absl::IsFailedPrecondition(hand.manual->SetLamp(7, 0).get()));
  EXPECT_TRUE(absl::IsFailedPrecondition(hand.manual->Jog(7, 0, 0.1)));
  EXPECT_TRUE(hand.Said().empty());
}

TEST(ManualControl, HomeMoveLampAndOffAtTheEnd) {
  Hand hand;
  hand.manual->Admit(5);
  EXPECT_EQ(hand.manual->Home(5, 0).get(), OkStatus());
  EXPECT_EQ(hand.manual->MoveTo(5, 0, RadFromDeg(20)).get(), OkStatus());
  EXPECT_EQ(hand.manual->SetLamp(5, 1).get(), OkStatus());
  EXPECT_NEAR(hand.axes[0]->Read().position_rad, RadFromDeg(20), 1e-12);
  EXPECT_TRUE(hand.lamps.anything_on());
  // What was commanded and what was read back are told apart.
  int commanded = 0, read_back = 0;
  for (const Reading& reading : hand.manual->GetStatus().readings) {
    (reading.source == ReadingSource::kCommanded ? commanded : read_back) += 1;
  }
  EXPECT_EQ(commanded, 2);
  EXPECT_EQ(read_back, 1);
  hand.manual->Close(5, "the lease expired");
  hand.ExpectOff();
  EXPECT_FALSE(hand.manual->GetStatus().open);
  EXPECT_THAT(Text(hand.manual->SetLamp(5, 1).get()), HasSubstr("lease 5 is over"));
}

TEST(ManualControl, ValuesOutOfRangeAreRefused) {
  Hand hand;
  hand.manual->Admit(1);
  const double nan = std::nan("");
  const auto& axis = hand.rig.axes[0];
  for (const int which : {-1, 2, 1 << 30}) {
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->Home(1, which).get()));
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->Jog(1, which, 0.1)));
  }
  for (const double angle : {nan, 1e300, axis.max_rad * 1.01, axis.min_rad - 0.01}) {
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->MoveTo(1, 0, angle).get())) << angle;
  }
  for (const double rate : {nan, -HUGE_VAL, axis.max_velocity_rad_s * 1.01}) {
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->Jog(1, 0, rate))) << rate;
  }
  for (const int lamp : {-2, 100}) {
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->SetLamp(1, lamp).get()));
  }
  EXPECT_THAT(Text(hand.manual->TestLaser(1, 1).get()), HasSubstr("no laser"));
  EXPECT_TRUE(hand.Said().empty());
}

TEST(ManualControl, HomedFirst) {
  Hand hand;
  hand.manual->Admit(1);
  EXPECT_THAT(Text(hand.manual->MoveTo(1, 0, 0.1).get()), HasSubstr("home it first"));
  EXPECT_EQ(hand.manual->Jog(1, 0, 0.1), OkStatus());
  hand.AsMember([&] { hand.clock.SleepFor(10 * kMs); });
  EXPECT_THAT(Text(hand.manual->Jog(1, 0, 0.1)), HasSubstr("home it first"));
  for (const std::string& said : hand.Said()) {
    EXPECT_THAT(said, Not(HasSubstr("enable")));
    EXPECT_THAT(said, Not(HasSubstr("move")));
  }
}

TEST(ManualControl, NothingWhileTheChainIsOpen) {
  Hand hand(SmallLaserRig());
  hand.forbidden = true;
  hand.manual->Admit(1);
  EXPECT_THAT(Text(hand.manual->Home(1, 0).get()), HasSubstr("door"));
  EXPECT_THAT(Text(hand.manual->SetLamp(1, 0).get()), HasSubstr("door"));
  EXPECT_THAT(Text(hand.manual->TestLaser(1, 1).get()), HasSubstr("door"));
  EXPECT_EQ(hand.lines.edges(), 0);
  EXPECT_EQ(hand.manual->SetLamp(1, -1).get(), OkStatus()) << "off is always possible";
  EXPECT_FALSE(hand.lamps.anything_on());
}

// The stop comes 200 ms after the last message, to the nanosecond.
TEST(ManualControl, AJogEndsWhenNobodyHoldsIt) {
  Hand hand;
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  std::atomic<int64_t> stopped{0};
  hand.log.OnOperation([&](int, const std::string& operation) {
    if (operation == "turntable quick stop") stopped = hand.clock.Now().count();
    return OkStatus();
  });
  RigTime last{};
  hand.AsMember([&] {
    for (int i = 0; i < 20; ++i) {
      last = hand.clock.Now();
      EXPECT_EQ(hand.manual->Jog(1, 0, RadFromDeg(5)), OkStatus());
      hand.clock.SleepFor(50 * kMs);
      EXPECT_EQ(stopped, 0) << "it is held";
    }
    hand.clock.SleepFor(2000 * kMs);
  });
  EXPECT_EQ(stopped, (last + 200 * kMs).count());
  EXPECT_FALSE(hand.axes[0]->Read().enabled);
  EXPECT_TRUE(hand.manual->GetStatus().doing.empty());
  hand.log.OnOperation(nullptr);
}

TEST(ManualControl, AJogEndsWhenItIsLetGoAndFollowsItsRate) {
  Hand hand;
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  hand.AsMember([&] {
    EXPECT_EQ(hand.manual->Jog(1, 0, RadFromDeg(5)), OkStatus());
    hand.clock.SleepFor(100 * kMs);
    EXPECT_THAT(Text(hand.manual->Jog(1, 1, 0.1)), HasSubstr("is being jogged"));
    EXPECT_EQ(hand.manual->Jog(1, 0, RadFromDeg(-3)), OkStatus());
    hand.clock.SleepFor(100 * kMs);
    EXPECT_EQ(hand.manual->Jog(1, 0, 0), OkStatus());
    hand.clock.SleepFor(1 * kMs);
    EXPECT_FALSE(hand.axes[0]->Read().moving);
  });
  const auto said = hand.Said();
  EXPECT_THAT(said, ::testing::Contains("turntable speed 5"));
  EXPECT_THAT(said, ::testing::Contains("turntable speed 3"));
  EXPECT_THAT(Text(hand.manual->MoveTo(1, 0, 0.1).get()), "") << "the next order is served";
}

TEST(ManualControl, TheLaserShinesForItsTimeAndNotAfterTheLease) {
  Hand hand(SmallLaserRig());
  hand.manual->Admit(1);
  std::future<Status> test, cut;
  bool lit = false;
  hand.AsMember([&] {
    test = hand.manual->TestLaser(1, 1);
    hand.clock.SleepFor(500 * kMs);
    lit = hand.lines.lit();
    hand.clock.SleepFor(1000 * kMs);
  });
  EXPECT_TRUE(lit);
  EXPECT_EQ(test.get(), OkStatus());
  EXPECT_FALSE(hand.lines.lit());
  for (const double seconds : {0.0, -1.0, 10.1, std::nan("")}) {
    EXPECT_TRUE(absl::IsInvalidArgument(hand.manual->TestLaser(1, seconds).get()));
  }
  hand.AsMember([&] {
    cut = hand.manual->TestLaser(1, 10);
    hand.clock.SleepFor(500 * kMs);
    hand.manual->Close(1, "the lease expired");
    hand.clock.SleepFor(FromSeconds(kLaserOneShot_s) + kMs);
    EXPECT_FALSE(hand.lines.lit());
  });
  EXPECT_TRUE(absl::IsCancelled(cut.get()));
  hand.ExpectOff();
}

// An operation that puts energy into the rig.
bool Energises(const std::string& operation) {
  const bool lamp = operation.starts_with("lamp ") && operation != "lamp -1";
  return lamp || operation.ends_with("enable") || operation.ends_with("home") ||
         operation.find(" move ") != std::string::npos;
}

// The lease ends, or somebody says stop, in the middle of each operation: nothing is energised
// after it for the old token, and everything goes off.
class ManualControlCut : public ::testing::TestWithParam<const char*> {};
TEST_P(ManualControlCut, AtEachOperation) {
  const std::string how = GetParam();
  for (int at = 0;; ++at) {
    Hand hand;
    hand.manual->Admit(1);
    std::atomic<bool> cut{false}, ended{false};
    std::vector<std::string> after;
    std::promise<void> given;  // all orders are, before the first is carried out
    const std::shared_future<void> all_given = given.get_future().share();
    hand.log.OnOperation([&](int index, const std::string& operation) {
      all_given.wait();
      if (index == at && !ended) {
        if (how == "stop") hand.manual->Stop("stopped");
        if (how == "close" || how == "hand over") hand.manual->Close(1, "the lease expired");
        if (how == "hand over") hand.manual->Admit(2);
        cut = true;
      } else if (cut) {
        after.push_back(operation);
      }
      return OkStatus();
    });
    std::vector<std::future<Status>> orders;
    orders.push_back(hand.manual->Home(1, 1));
    orders.push_back(hand.manual->SetLamp(1, 0));
    orders.push_back(hand.manual->MoveTo(1, 1, RadFromDeg(-20)));
    given.set_value();
    std::vector<Status> ends;
    for (auto& order : orders) ends.push_back(order.get());
    ended = true;
    hand.manual->Close(2, "the end");
    hand.ExpectOff();
    hand.log.OnOperation(nullptr);  // its variables go before manual control does
    if (!cut) {
      EXPECT_GT(at, 8);
      break;
    }
    for (const std::string& operation : after) EXPECT_FALSE(Energises(operation)) << operation;
  }
}
INSTANTIATE_TEST_SUITE_P(How, ManualControlCut, ::testing::Values("stop", "close", "hand over"));

// What the one before left on is off before the first command of the next.
TEST(ManualControl, ANewLeaseBeginsInTheDark) {
  Hand hand;
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  ASSERT_EQ(hand.manual->SetLamp(1, 0).get(), OkStatus());
  const size_t before = hand.Said().size();
  hand.manual->Admit(2);
  EXPECT_FALSE(hand.manual->SetLamp(1, 1).get().ok());
  ASSERT_EQ(hand.manual->SetLamp(2, 1).get(), OkStatus());
  const auto said = hand.Said();
  ASSERT_GT(said.size(), before + 2);
  EXPECT_EQ(said[before], "lamps off");
  EXPECT_EQ(said.back(), fmt::format("lamp {}", hand.rig.lamps[1].channel));
  EXPECT_THAT(said, ::testing::Contains("turntable disable"));
}

TEST(ManualControl, AfterAStopTheLeaseGoesOn) {
  Hand hand;
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->SetLamp(1, 0).get(), OkStatus());
  hand.manual->Stop("stopped");
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  EXPECT_FALSE(hand.lamps.anything_on());
  ASSERT_EQ(hand.manual->SetLamp(1, 0).get(), OkStatus());
  EXPECT_TRUE(hand.lamps.anything_on());
}

// Somebody says stop to Safety, or it trips, while an axis jogs and a lamp burns: both end at once,
// whoever holds the button is told why and must let go, and a note says it.
class ManualControlSafety : public ::testing::TestWithParam<bool> {};
TEST_P(ManualControlSafety, EndsWhatIsDoneByHandAndSaysWhy) {
  const bool trips = GetParam();
  Hand hand(SmallRig(), true);
  const std::string why = trips ? "safety: door" : "stopped: a hand in the rig";
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  ASSERT_EQ(hand.manual->SetLamp(1, 0).get(), OkStatus());
  hand.AsMember([&] {
    for (int i = 0; i < 4; ++i) {
      EXPECT_EQ(hand.manual->Jog(1, 0, RadFromDeg(5)), OkStatus());
      hand.clock.SleepFor(50 * kMs);
    }
    EXPECT_TRUE(hand.axes[0]->Read().moving);
    if (trips) {
      hand.lines.Set(hand.rig.lines.door, false);
    } else {
      EXPECT_EQ(hand.safety->StopNow(why), OkStatus());
    }
    hand.clock.SleepFor(1 * kMs);
    EXPECT_FALSE(hand.axes[0]->Read().moving);
    EXPECT_FALSE(hand.axes[0]->Read().enabled);
    EXPECT_FALSE(hand.lamps.anything_on());
    const Status told = hand.manual->Jog(1, 0, RadFromDeg(5));
    EXPECT_TRUE(absl::IsCancelled(told)) << told;
    EXPECT_EQ(Text(told), why);
    hand.clock.SleepFor(50 * kMs);
    EXPECT_FALSE(hand.axes[0]->Read().moving) << "the button is still held";
    EXPECT_EQ(hand.manual->GetStatus().doing, "");
  });
  EXPECT_TRUE(hand.manual->GetStatus().open) << "the lease goes on";
  const Status next = hand.manual->SetLamp(1, 0).get();
  EXPECT_EQ(next.ok(), !trips) << next;
  if (trips) {
    EXPECT_THAT(Text(next), HasSubstr("door (line 1) is open"));
  }
  hand.manual->Close(1, "the end");
  hand.ExpectOff();
  EXPECT_THAT(hand.notes, ::testing::Contains("by hand: everything is off: " + why).Times(1));
}
INSTANTIATE_TEST_SUITE_P(How, ManualControlSafety, ::testing::Bool(),
                         [](const auto& how) { return how.param ? "Trip" : "Stop"; });

// Nobody commands anything, and the lease goes on: that is no hang.
TEST(ManualControl, ALampBurnsAsLongAsTheLease) {
  Hand hand(SmallRig(), true);
  hand.manual->Admit(1);
  ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
  ASSERT_EQ(hand.manual->SetLamp(1, 0).get(), OkStatus());
  hand.AsMember([&] { hand.clock.SleepFor(60'000 * kMs); });
  EXPECT_TRUE(hand.lamps.anything_on());
  EXPECT_EQ(hand.safety->Permit(), OkStatus());
  hand.manual->Close(1, "the end");
  hand.ExpectOff();
}

TEST(ManualControl, AStopEndsAMoveAndTheLaserWithItsReason) {
  for (const bool shines : {false, true}) {
    Hand hand(SmallLaserRig(), true);
    hand.manual->Admit(1);
    ASSERT_EQ(hand.manual->Home(1, 0).get(), OkStatus());
    std::future<Status> done;
    hand.AsMember([&] {
      done = shines ? hand.manual->TestLaser(1, 10) : hand.manual->MoveTo(1, 0, RadFromDeg(90));
      hand.clock.SleepFor(300 * kMs);
      EXPECT_EQ(hand.safety->StopNow("stopped: enough"), OkStatus());
      hand.clock.SleepFor(FromSeconds(kLaserOneShot_s) + kMs);
      EXPECT_FALSE(hand.axes[0]->Read().moving);
      EXPECT_FALSE(hand.lines.lit());
    });
    const Status ended = done.get();
    EXPECT_TRUE(absl::IsCancelled(ended)) << ended;
    EXPECT_EQ(Text(ended), "stopped: enough");
  }
}

TEST(ManualControl, ADeviceThatFailsEndsItsOrderAndIsSwitchedOff) {
  for (const std::string fails : {"turntable enable", "turntable home", "turntable homed"}) {
    Hand hand;
    hand.manual->Admit(1);
    hand.log.OnOperation([&](int, const std::string& operation) {
      return operation == fails ? Unavailable("drive gone") : OkStatus();
    });
    EXPECT_TRUE(absl::IsUnavailable(hand.manual->Home(1, 0).get())) << fails;
    EXPECT_FALSE(hand.axes[0]->Read().enabled);
    EXPECT_EQ(hand.manual->Home(1, 1).get(), OkStatus()) << "the other one is well";
  }
}

}  // namespace
}  // namespace mesorig::daemon
