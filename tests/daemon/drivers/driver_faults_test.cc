// The drivers against a simulator that injects faults: what is wrong is told by name, counted, and
// over once the device is opened again, without a restart.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr Region kWhole{0, 0, 16, 8};

std::string Text(const Status& status) { return std::string(Message(status)); }

class DriverFaultsTest : public ::testing::Test {
 protected:
  void Inject(const std::string& text) { ASSERT_EQ(sim_.Inject(text), OkStatus()) << text; }
  void Sleep(RigTime span) { end_.link->SleepFor(span); }
  RigTime Now() { return end_.link->Now(); }

  const Rig rig_ = SmallRig();
  SimRig sim_{rig_};
  RigEnd end_{sim_, rig_};
  RigClock::Member member_{*end_.link, "test"};
  RigClock::Activity activity_{*end_.link, Pace::kFree};
};

class CameraFaultsTest : public DriverFaultsTest {
 protected:
  void Ready() {
    ASSERT_EQ(camera_->Open(), OkStatus());
    ASSERT_EQ(camera_->Configure(0.02, kWhole, 0), OkStatus());
  }
  StatusOr<CapturedFrame> Shoot() {
    const Status triggered = camera_->Trigger(++trigger_);
    if (!triggered.ok()) return triggered;
    return camera_->Await(trigger_, Now() + seconds(1));
  }
  // One shot under this fault, then one without.
  Status ShootUnder(const std::string& fault) {
    EXPECT_EQ(sim_.Inject("camera:1000 " + fault), OkStatus());
    const Status status = Shoot().status();
    const auto next = Shoot();
    EXPECT_TRUE(next.ok()) << fault << ": " << next.status();
    EXPECT_EQ(next.ok() ? next->trigger_id : 0, trigger_);
    return status;
  }
  std::unique_ptr<Camera> camera_ = MakeCamera("sim_camera", end_.context, 0).value();
  uint32_t trigger_ = 0;
};

TEST_F(CameraFaultsTest, EachKindIsToldApartAndDropped) {
  Ready();
  ASSERT_TRUE(Shoot().ok());
  const auto expect = [&](const std::string& fault, const char* said) {
    const Status status = ShootUnder(fault);
    EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << fault << ": " << status;
    EXPECT_THAT(Text(status), HasSubstr("camera C0: no frame of trigger"));
    EXPECT_THAT(Text(status), HasSubstr(said)) << fault;
  };
  expect("drop", "s");
  expect("silent 1", "s");
  expect("torn", "(instead: 1 torn)");
  expect("corrupt", "(instead: 1 damaged)");
  expect("stale", "(instead: 1 stale)");
  expect("wrong_id", "(instead: 1 of a trigger that was not given)");
  expect("delay 1500", "s");
  expect("delay 300 in", "1 mistimed)");
  const FrameFaults faults = camera_->frame_faults();
  EXPECT_EQ(faults.lost, 8u);
  EXPECT_EQ(faults.torn, 1u);
  EXPECT_EQ(faults.damaged, 1u);
  EXPECT_EQ(faults.stale, 1u);
  EXPECT_EQ(faults.wrong_id, 1u);
  EXPECT_EQ(faults.late, 1u) << "the one that came 1.5 s late";
  EXPECT_EQ(faults.mistimed, 1u);
  EXPECT_EQ(ShootUnder("duplicate"), OkStatus());
  EXPECT_EQ(camera_->frame_faults().duplicate, 1u);
  EXPECT_EQ(camera_->dropped_frames(), 7u);
}

TEST_F(CameraFaultsTest, ClockThatJumpedIsTakenAnewByOpen) {
  Ready();
  ASSERT_TRUE(Shoot().ok());
  for (const char* jump : {"clock -100", "clock 3.25"}) {
    Inject(std::string("camera:1000 ") + jump);
    EXPECT_THAT(Text(Shoot().status()), HasSubstr("mistimed"));
    EXPECT_THAT(Text(Shoot().status()), HasSubstr("mistimed")) << "for good";
    Ready();
    const RigTime then = Now();
    const auto frame = Shoot();
    ASSERT_TRUE(frame.ok()) << frame.status();
    EXPECT_EQ(frame->exposure_start, then) << "of the rig's clock";
  }
}

// The test of the issue: replugged, found by its serial number, and used on, without a restart.
TEST_F(CameraFaultsTest, RepluggedCameraComesBackBySerialNumber) {
  Ready();
  ASSERT_TRUE(Shoot().ok());
  Inject("camera:1000 disconnect");
  const auto gone = Shoot();
  EXPECT_TRUE(absl::IsUnavailable(gone.status())) << gone.status();
  EXPECT_THAT(Text(gone.status()), HasSubstr("camera C0: no frame of trigger 2"));
  EXPECT_THAT(Text(gone.status()), HasSubstr("camera:1000 is not there"));
  EXPECT_TRUE(absl::IsUnavailable(camera_->Open()));
  EXPECT_TRUE(absl::IsUnavailable(camera_->Configure(0.02, kWhole, 0)));
  auto other = MakeCamera("sim_camera", end_.context, 1).value();
  EXPECT_EQ(other->Open(), OkStatus()) << "the other camera is another serial number";
  Inject("camera:1000 replug 700");
  EXPECT_TRUE(absl::IsUnavailable(camera_->Open()));
  Sleep(milliseconds(800));
  Ready();
  const auto frame = Shoot();
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->trigger_id, trigger_);
  EXPECT_EQ(frame->exposure_end - frame->exposure_start, RigTime(milliseconds(20)))
      << "its settings were told again";
}

TEST_F(CameraFaultsTest, ReplugThatNobodyNoticedNeverPassesForTheSameCamera) {
  Ready();
  ASSERT_TRUE(Shoot().ok());
  Inject("camera:1000 disconnect");
  Inject("camera:1000 replug");
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(Shoot().ok());
  Ready();
  EXPECT_TRUE(Shoot().ok());
}

class LampFaultsTest : public DriverFaultsTest {
 protected:
  std::vector<double> Commanded() {
    std::vector<double> levels;
    sim_.Exclusive([&](RigTime) { levels = sim_.lamps.CommandedLevels(); });
    return levels;
  }
  std::unique_ptr<LampBank> lamps_ = MakeLampBank("modbus_lamps", end_.context).value();
};

TEST_F(LampFaultsTest, OneBadAnswerIsAskedForAgain) {
  ASSERT_EQ(lamps_->Open(), OkStatus());
  for (const char* fault : {"lamps drop", "lamps drop in", "lamps delay 50", "lamps corrupt",
                            "lamps close", "lamps duplicate"}) {
    Inject(fault);
    EXPECT_EQ(lamps_->SwitchTo(0), OkStatus()) << fault;
    EXPECT_THAT(Commanded(), ElementsAre(1, 0)) << fault;
    EXPECT_EQ(lamps_->SwitchTo(-1), OkStatus()) << fault;
    EXPECT_THAT(Commanded(), ElementsAre(0, 0)) << fault;
  }
  const ModbusCounts counts = end_.modbus->counts();
  EXPECT_EQ(counts.unanswered, 3u);
  EXPECT_GE(counts.damaged + counts.broken, 2u);
  EXPECT_GE(counts.connections, 5u);
}

TEST_F(LampFaultsTest, DamagedAnswersAreNeverTakenForGood) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  Sleep(seconds(1));
  int wrong = 0;
  for (int i = 0; i < 12; ++i) {
    Inject("lamps corrupt");
    const auto levels = lamps_->ReadLevels();
    // A byte of the value itself is not protected (TCP's checksum does that); what it says then is
    // far from the truth, and the sequencer's second reading tells.
    if (levels.ok() && (std::abs((*levels)[0] - 1) > 0.02 || (*levels)[1] > 0.02)) ++wrong;
  }
  EXPECT_LT(wrong, 8);
  EXPECT_THAT(lamps_->ReadLevels().value(), ElementsAre(1, 0));
}

TEST_F(LampFaultsTest, ExceptionsAndDeadSlavesAreNamed) {
  ASSERT_EQ(lamps_->Open(), OkStatus());
  Inject("lamps exception");
  const Status refused = lamps_->SwitchTo(0);
  EXPECT_TRUE(absl::IsUnavailable(refused));
  EXPECT_THAT(Text(refused), HasSubstr("lamp bank: Modbus 127.0.0.1:"));
  EXPECT_THAT(Text(refused), HasSubstr("Slave device or server failure"));
  EXPECT_EQ(end_.modbus->counts().refused, 1u);
  Inject("lamps drop 2");
  EXPECT_TRUE(absl::IsUnavailable(lamps_->Open())) << "nor a second time";
  EXPECT_EQ(lamps_->Open(), OkStatus());
}

TEST_F(LampFaultsTest, UnpluggedBankIsReconnected) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  Inject("lamps disconnect");
  const Status gone = lamps_->Open();
  EXPECT_TRUE(absl::IsUnavailable(gone));
  EXPECT_THAT(Text(gone), HasSubstr("lamp bank: Modbus"));
  EXPECT_FALSE(lamps_->AllOff().ok());
  EXPECT_FALSE(lamps_->Open().ok()) << "refused";
  Sleep(seconds(2));
  EXPECT_THAT(Commanded(), ElementsAre(0, 0)) << "by the bank's communication-loss timeout";
  Inject("lamps replug");
  EXPECT_EQ(lamps_->Open(), OkStatus());
  EXPECT_EQ(lamps_->SwitchTo(1 + 1), OkStatus());
  EXPECT_THAT(Commanded(), ElementsAre(0, 1));
}

class AxisFaultsTest : public DriverFaultsTest {
 protected:
  void Ready() {
    ASSERT_EQ(axis_->Enable(), OkStatus());
    if (axis_->Read().referenced) return;
    ASSERT_EQ(axis_->StartHoming(), OkStatus());
    ASSERT_EQ(axis_->AwaitHoming(Now() + seconds(30)), OkStatus());
  }
  Status Move(double deg) {
    const Status started = axis_->StartMove(RadFromDeg(deg));
    return started.ok() ? axis_->AwaitMove(Now() + seconds(10)) : started;
  }
  double WorldDeg() {
    double counts = 0;
    sim_.Exclusive([&](RigTime now) { counts = sim_.can.node(0).WorldCounts(now); });
    return counts / 100;
  }
  bool TorqueOn() {
    bool on = false;
    sim_.Exclusive([&](RigTime) { on = sim_.can.node(0).torque_on(); });
    return on;
  }
  std::unique_ptr<Axis> axis_ = MakeAxis("cia402", end_.context, 0).value();
};

TEST_F(AxisFaultsTest, LostStepsAreToldWithBothAngles) {
  Ready();
  Inject("can turntable lose 1");
  const Status status = Move(30);
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_THAT(Text(status), HasSubstr("axis turntable (node 5)"));
  EXPECT_THAT(Text(status), HasSubstr("commanded 30.0000 deg, it stands at 29.0000 deg"));
  ASSERT_EQ(axis_->Disable(), OkStatus());
  Ready();
  ASSERT_EQ(Move(30), OkStatus());
  EXPECT_NEAR(WorldDeg(), 30, 0.01);
}

TEST_F(AxisFaultsTest, AxisThatIsKnockedAsideDoesNotHold) {
  EXPECT_FALSE(axis_->CheckHolds().ok()) << "not enabled";
  Ready();
  ASSERT_EQ(Move(30), OkStatus());
  EXPECT_EQ(axis_->CheckHolds(), OkStatus());
  Inject("can turntable lose -0.5");
  Sleep(milliseconds(50));  // a few of the drive's reports
  const Status status = axis_->CheckHolds();
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_THAT(Text(status), HasSubstr("commanded 30.0000 deg, it stands at 30.5000 deg"));
}

TEST_F(AxisFaultsTest, StuckAxisIsAFollowingError) {
  Ready();
  Inject("can turntable stuck");
  const RigTime then = Now();
  const Status status = Move(30);
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_THAT(Text(status), HasSubstr("axis turntable (node 5): following error"));
  EXPECT_THAT(Text(status), HasSubstr("commanded 30.0000 deg, it stands at 0.0000 deg"));
  EXPECT_LT(Now() - then, RigTime(seconds(1))) << "not only at the deadline";
  EXPECT_EQ(axis_->QuickStop(), OkStatus());
  EXPECT_EQ(axis_->Disable(), OkStatus());
  EXPECT_FALSE(TorqueOn());
  Inject("can turntable free");
  Ready();
  EXPECT_EQ(Move(30), OkStatus());
}

TEST_F(AxisFaultsTest, DriveThatLostItsSupplyIsConfiguredAgainAndHomed) {
  Ready();
  ASSERT_EQ(Move(20), OkStatus());
  Inject("can turntable disconnect");
  const Status gone = Move(30);
  EXPECT_FALSE(gone.ok());
  EXPECT_THAT(Text(gone), HasSubstr("axis turntable (node 5)"));
  EXPECT_TRUE(absl::IsDeadlineExceeded(axis_->Enable()));
  Inject("can turntable replug");
  Sleep(milliseconds(10));
  ASSERT_EQ(axis_->Enable(), OkStatus());
  EXPECT_FALSE(axis_->Read().referenced);
  Ready();
  ASSERT_EQ(Move(30), OkStatus());
  EXPECT_NEAR(WorldDeg(), 30, 0.01);
}

TEST_F(AxisFaultsTest, RestartWhoseBootUpMessageIsLostIsNoticed) {
  Ready();
  ASSERT_EQ(Move(20), OkStatus());
  Inject("can turntable disconnect");
  Inject("can turntable drop");
  Inject("can turntable replug");
  Sleep(milliseconds(10));
  ASSERT_EQ(axis_->Enable(), OkStatus());
  EXPECT_FALSE(axis_->Read().referenced) << "by its settings, which are gone";
}

TEST_F(AxisFaultsTest, LostDamagedAndDoubledTelegramsDoNotMisplaceIt) {
  Ready();
  double target = 10;
  for (const char* fault :
       {"drop", "drop in", "drop 3", "drop 3 in", "corrupt", "corrupt 3", "corrupt in",
        "duplicate 5", "duplicate 5 in", "delay 120 4", "delay 120 4 in"}) {
    Inject(std::string("can turntable ") + fault);
    const Status status = Move(target);
    if (status.ok()) {
      EXPECT_NEAR(WorldDeg(), target, 0.11) << fault;
    } else {
      EXPECT_THAT(Text(status), HasSubstr("axis turntable (node 5)")) << fault;
    }
    target = -target;
    Sleep(seconds(1));
    Inject("can turntable drop 0");
    Inject("can turntable drop 0 in");
    Inject("can turntable corrupt 0");
    Inject("can turntable corrupt 0 in");
    (void)axis_->QuickStop();
    ASSERT_EQ(axis_->Disable(), OkStatus()) << fault;
    ASSERT_FALSE(TorqueOn()) << fault;
    Ready();
  }
}

TEST_F(AxisFaultsTest, TorqueGoesOffWhateverIsLost) {
  for (const char* fault : {"drop 2", "drop 2 in", "drop 7 in", "drop 1000", "drop 1000 in"}) {
    Ready();
    ASSERT_EQ(axis_->StartMove(RadFromDeg(axis_->Read().position_rad > 0 ? -90 : 90)), OkStatus());
    Sleep(milliseconds(300));
    ASSERT_TRUE(TorqueOn());
    Inject(std::string("can turntable ") + fault);
    (void)axis_->QuickStop();
    (void)axis_->Disable();
    EXPECT_FALSE(TorqueOn()) << fault;
    Inject("can turntable drop 0");
    Inject("can turntable drop 0 in");
  }
}

TEST_F(DriverFaultsTest, LineThatDoesNotAnswerIsNoLevel) {
  auto lines = MakeDigitalLines("gpio_lines", end_.context).value();
  EXPECT_TRUE(lines->Read(rig_.lines.door).value());
  Inject("lines drop");
  const auto level = lines->Read(rig_.lines.door);
  EXPECT_TRUE(absl::IsUnavailable(level.status()));
  EXPECT_THAT(Text(level.status()), HasSubstr("line 1: lines does not answer"));
  Inject("lines stuck door");
  Inject("lines door open");
  EXPECT_TRUE(lines->Read(rig_.lines.door).value()) << "it no longer follows";
  Inject("lines free door");
  EXPECT_FALSE(lines->Read(rig_.lines.door).value());
}

TEST_F(DriverFaultsTest, TimeThatLeapsIsLivedThroughByTheDevices) {
  auto lamps = MakeLampBank("modbus_lamps", end_.context).value();
  ASSERT_EQ(lamps->SwitchTo(0), OkStatus());
  const RigTime then = Now();
  Inject("rig leap 5");
  Sleep(milliseconds(1));
  EXPECT_GE(Now(), then + seconds(5));
  double level = 1;
  sim_.Exclusive([&](RigTime) { level = sim_.lamps.CommandedLevels()[0]; });
  EXPECT_EQ(level, 0) << "the bank heard nothing for 5 s";
  EXPECT_TRUE(absl::IsInvalidArgument(sim_.Inject("rig leap -1")));
  EXPECT_TRUE(absl::IsInvalidArgument(sim_.Inject("nobody drop")));
}

}  // namespace
}  // namespace mesorig::daemon
