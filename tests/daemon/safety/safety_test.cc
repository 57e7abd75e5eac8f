#include "daemon/safety/safety.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <future>

#include "tests/daemon/fakes/fake_devices.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

// The small rig with a laser in memory; the test's thread is whoever drives it.
class SafetyTest : public ::testing::Test {
 protected:
  SafetyTest() {
    lines_.AddOneShot(rig_.lines.laser_trigger, rig_.lines.laser_on);
    for (const auto& axis : rig_.axes) {
      axes_.push_back(std::make_unique<FakeAxis>(clock_, stop_, log_, axis));
      devices_.axes.push_back(axes_.back().get());
    }
    devices_.lamps = &lamps_;
    devices_.lines = &lines_;
    SafetyOptions options;
    options.host_hang = std::chrono::milliseconds(400);
    safety_ = std::make_unique<Safety>(clock_, rig_, devices_, stop_, options);
  }
  void PressReset() {
    lines_.Set(rig_.lines.reset, false);
    lines_.Set(rig_.lines.reset, true);
  }
  // With torque and light.
  void TurnOn() {
    for (Axis* axis : safety_->axes()) {
      ASSERT_EQ(axis->Enable(), OkStatus());
      ASSERT_EQ(axis->StartHoming(), OkStatus());
      ASSERT_EQ(axis->AwaitHoming(kNever), OkStatus());
    }
    ASSERT_EQ(safety_->lamps()->SwitchTo(0), OkStatus());
  }
  void ExpectOff() {
    EXPECT_FALSE(lamps_.anything_on());
    for (const auto& axis : axes_) EXPECT_FALSE(axis->Read().torque) << axis->name();
  }
  std::string WhyNot() { return std::string(Message(safety_->MayEnergise())); }
  void Pass(double seconds) { clock_.SleepFor(FromSeconds(seconds)); }

  static Rig MakeRig() {
    Rig rig = SmallLaserRig();
    rig.lamp_bank.housing_temperatures = true;
    rig.lamp_bank.max_housing_c = 200;
    return rig;
  }
  FakeRigClock clock_;
  RigClock::Member member_{clock_, "test"};
  RigClock::Activity activity_{clock_, Pace::kFree};
  StopFlag stop_{clock_};
  const Rig rig_ = MakeRig();
  OperationLog log_;
  std::vector<std::unique_ptr<FakeAxis>> axes_;
  FakeLampBank lamps_{clock_, log_, rig_};
  FakeLines lines_{clock_};
  SafetyDevices devices_;
  std::unique_ptr<Safety> safety_;
};

TEST_F(SafetyTest, AnOpeningTakesTheEnergyAndNeedsAResetAfterClosing) {
  TurnOn();
  safety_->chain().Arm();
  lines_.Set(rig_.lines.estop, false);
  Pass(0.2);
  ExpectOff();
  EXPECT_FALSE(stop_.Check().ok());
  EXPECT_THAT(WhyNot(), HasSubstr("emergency stop (line 0) is open"));
  PressReset();  // while it is open
  lines_.Set(rig_.lines.estop, true);
  EXPECT_THAT(WhyNot(), HasSubstr("press reset (line 2)"));
  EXPECT_FALSE(safety_->Reset().ok()) << "no console clears that";
  EXPECT_TRUE(absl::IsFailedPrecondition(safety_->axes()[0]->Enable()));
  EXPECT_TRUE(absl::IsFailedPrecondition(safety_->lamps()->SwitchTo(0)));
  PressReset();
  EXPECT_EQ(WhyNot(), "");
  ExpectOff();  // a reset switches nothing on
  EXPECT_EQ(safety_->axes()[0]->Enable(), OkStatus());
}

TEST_F(SafetyTest, ALevelIsEnoughAndSoIsALineThatCannotBeRead) {
  TurnOn();
  lines_.Break();
  Pass(0.2);
  ExpectOff();
  lines_.Mend();
  EXPECT_THAT(std::string(Message(safety_->Permit())), HasSubstr("could not be read"));
  EXPECT_EQ(safety_->Reset(), OkStatus()) << "nothing opened: a console may clear that";
}

TEST_F(SafetyTest, TheContactorIsReadBack) {
  lines_.Set(rig_.lines.power, false);
  Pass(1);
  EXPECT_THAT(WhyNot(), HasSubstr("the contactor is open"));
  EXPECT_FALSE(safety_->Reset().ok());
  lines_.Set(rig_.lines.power, true);
  PressReset();
  EXPECT_EQ(WhyNot(), "");
  lines_.Set(rig_.lines.door, false);  // and the contactor stays closed
  Pass(1);
  EXPECT_NE(safety_->state().causes & Bit(TripCause::kContactor), 0);
}

TEST_F(SafetyTest, ARigThatWasJustSwitchedOnWaitsForReset) {
  safety_.reset();
  lines_.Set(rig_.lines.power, false);
  safety_ = std::make_unique<Safety>(clock_, rig_, devices_, stop_);
  EXPECT_THAT(WhyNot(), HasSubstr("reset was not pressed since the rig was switched on"));
  lines_.Set(rig_.lines.power, true);
  PressReset();
  EXPECT_EQ(WhyNot(), "");
}

TEST_F(SafetyTest, WhatAnEarlierDaemonLeftOnIsNoHang) {
  safety_.reset();
  Pass(3600);
  ASSERT_EQ(axes_[0]->Enable(), OkStatus());
  safety_ = std::make_unique<Safety>(clock_, rig_, devices_, stop_);
  EXPECT_EQ(WhyNot(), "");
  EXPECT_EQ(safety_->state().trips, 0u);
}

TEST_F(SafetyTest, AHandThatResetsWhileTheDaemonStartsIsSeen) {
  for (const int line : {rig_.lines.estop, rig_.lines.door, rig_.lines.power}) {
    safety_.reset();
    lines_.Set(rig_.lines.door, false);
    lines_.Set(rig_.lines.power, false);
    lines_.AfterReading(line, [this] {
      lines_.Set(rig_.lines.door, true);
      lines_.Set(rig_.lines.power, true);
      PressReset();
    });
    safety_ = std::make_unique<Safety>(clock_, rig_, devices_, stop_);
    EXPECT_EQ(WhyNot(), "") << "line " << line;
  }
}

TEST_F(SafetyTest, HotHousingTripsUntilItHasCooled) {
  TurnOn();
  lamps_.housing_c = {150, 199};
  Pass(2);
  EXPECT_TRUE(lamps_.anything_on());
  lamps_.housing_c = {150, 201.5};
  Pass(1.2);
  ExpectOff();
  EXPECT_THAT(WhyNot(), HasSubstr("lamp L1: its housing has 201.5 degrees C, permitted are 200"));
  lamps_.housing_c = {150, 195};
  EXPECT_FALSE(safety_->Reset().ok()) << "not cool yet";
  lamps_.housing_c = {100, 150};
  EXPECT_EQ(safety_->Reset(), OkStatus());
}

// The bank was gone as everything was switched off, and comes back with a lamp lit: however long it
// took, somebody looks.
TEST_F(SafetyTest, ALampThatComesBackLitIsSwitchedOff) {
  TurnOn();
  ASSERT_EQ(safety_->StopNow("enough"), OkStatus());
  lamps_.unreadable = true;
  Pass(119);
  lamps_.Light(rig_.lamps[1].channel);
  Pass(1);
  lamps_.unreadable = false;
  Pass(2);
  ExpectOff();
  EXPECT_THAT(WhyNot(), HasSubstr("lamp L1 is lit"));
  Pass(10);  // it glows for a while
  EXPECT_EQ(safety_->Reset(), OkStatus());
  // Later, and with nothing wrong before.
  Pass(60);
  lamps_.Light(rig_.lamps[0].channel);
  Pass(Safety::kCalmLampPoll_s + 1);
  ExpectOff();
  EXPECT_THAT(WhyNot(), HasSubstr("lamp L0 is lit"));
}

TEST_F(SafetyTest, NoWordFromWhoeverEnergisedIsAHang) {
  TurnOn();
  Pass(9);
  EXPECT_TRUE(lamps_.anything_on());
  safety_->Alive();
  Pass(9);
  EXPECT_TRUE(lamps_.anything_on());
  Pass(4);
  ExpectOff();
  EXPECT_THAT(WhyNot(), HasSubstr("no progress"));
  EXPECT_EQ(safety_->Reset(), OkStatus());
}

// The test's thread runs and never waits on the rig clock: time stands still, and still it is found.
TEST_F(SafetyTest, AMemberThatHangsOnTheHostClockIsFound) {
  TurnOn();
  while (safety_->Permit().ok()) ::usleep(10'000);  // a hang
  while (lamps_.anything_on()) ::usleep(1'000);
  EXPECT_THAT(std::string(Message(safety_->Permit())), HasSubstr("no progress"));
  EXPECT_FALSE(safety_->Health().ok());
  Pass(0.5);
  ExpectOff();
}

TEST_F(SafetyTest, StopNeedsNobody) {
  TurnOn();
  std::atomic<int> heard{0};
  const Listening stops =
      safety_->OnStop([&](std::string_view reason) { heard += reason == "a hand"; });
  // Whoever holds what it likes: a stop comes from another thread, and this one is busy.
  auto stopped = std::async(std::launch::async, [&] { return safety_->StopNow("a hand"); });
  EXPECT_EQ(stopped.get(), OkStatus());
  EXPECT_EQ(heard, 1);
  ExpectOff();
  EXPECT_EQ(safety_->stops(), 1u);
  {
    const Listening brief = safety_->OnStop([&](std::string_view) { heard += 100; });
  }
  auto again = std::async(std::launch::async, [&] { return safety_->StopNow("a hand"); });
  EXPECT_EQ(again.get(), OkStatus());
  EXPECT_EQ(heard, 2) << "who listens no more is not called";
  EXPECT_EQ(WhyNot(), "") << "a stop is no trip";
  EXPECT_THAT(log_.operations(), Contains("arc quick stop"));
}

TEST_F(SafetyTest, NoLaserBesideMotionAndNoMotionBesideLaser) {
  TurnOn();
  ASSERT_EQ(safety_->axes()[0]->StartMove(1), OkStatus());
  EXPECT_THAT(std::string(Message(safety_->gate()->Open())), HasSubstr("turntable moves"));
  ASSERT_EQ(safety_->axes()[0]->AwaitMove(kNever), OkStatus());
  ASSERT_EQ(safety_->gate()->Open(clock_.Now() + FromSeconds(2)), OkStatus());
  EXPECT_THAT(std::string(Message(safety_->axes()[0]->StartMove(0))), HasSubstr("gate is open"));
  for (int i = 0; i < 6; ++i) {  // beyond the sweep's end, though there is progress
    safety_->gate()->Progress();
    Pass(0.5);
  }
  EXPECT_FALSE(lines_.lit());
  EXPECT_EQ(safety_->axes()[0]->StartMove(0), OkStatus());
}

TEST_F(SafetyTest, ATripIsToldOnce) {
  std::vector<std::string> trips;
  const Listening heard =
      safety_->OnTrip([&](std::string_view trip) { trips.emplace_back(trip); });
  lines_.Set(rig_.lines.door, false);
  lines_.Set(rig_.lines.estop, false);
  Pass(1);
  EXPECT_EQ(safety_->state().trips, 1u);
  safety_.reset();
  ASSERT_EQ(trips.size(), 1u);
  EXPECT_THAT(trips[0], HasSubstr("door"));
}

}  // namespace
}  // namespace mesorig::daemon
