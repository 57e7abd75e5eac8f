// The driver against the simulator's CiA 402 nodes, in virtual time.

#include "daemon/drivers/cia402/cia402_axis.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon::cia402 {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::HasSubstr;

class Cia402AxisTest : public ::testing::Test {
 protected:
  std::string Text(const Status& status) { return std::string(Message(status)); }
  void EnableAndHome() {
    ASSERT_EQ(axis_->Enable(), OkStatus());
    ASSERT_EQ(axis_->StartHoming(), OkStatus());
    ASSERT_EQ(axis_->AwaitHoming(Now() + seconds(60)), OkStatus());
  }
  RigTime Now() { return end_.link->Now(); }
  double WorldCounts() {
    double counts = 0;
    sim_.Exclusive([&](RigTime now) { counts = sim_.can.node(0).WorldCounts(now); });
    return counts;
  }
  bool TorqueOn() {
    bool on = false;
    sim_.Exclusive([&](RigTime) { on = sim_.can.node(0).torque_on(); });
    return on;
  }

  const Rig rig_ = SmallRig();
  SimRig sim_{rig_};
  RigEnd end_{sim_, rig_};
  std::unique_ptr<Axis> axis_ = MakeAxis("cia402", end_.context, 0).value();
  RigClock::Member member_{*end_.link, "test"};
  RigClock::Activity activity_{*end_.link, Pace::kFree};
};

TEST_F(Cia402AxisTest, HomesMovesAndReadsBackCounts) {
  EnableAndHome();
  EXPECT_TRUE(axis_->Read().referenced);
  EXPECT_NEAR(WorldCounts(), 0, 0.5);
  const RigTime start = Now();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
  EXPECT_TRUE(axis_->Read().moving);
  ASSERT_EQ(axis_->AwaitMove(Now() + seconds(5)), OkStatus());
  // 90 deg at 90 deg/s and 180 deg/s^2: 1 s + 0.5 s.
  EXPECT_NEAR(Seconds(Now() - start), 1.5, 0.05);
  EXPECT_NEAR(axis_->Read().position_rad, RadFromDeg(90), RadFromDeg(0.01));
  EXPECT_NEAR(WorldCounts(), 9000, 0.5);
  EXPECT_FALSE(axis_->Read().moving);
  ASSERT_EQ(axis_->StartMove(RadFromDeg(-180)), OkStatus());
  ASSERT_EQ(axis_->AwaitMove(Now() + seconds(10)), OkStatus());
  EXPECT_NEAR(WorldCounts(), -18000, 0.5);
  ASSERT_EQ(axis_->Disable(), OkStatus());
  EXPECT_FALSE(TorqueOn());
  EXPECT_TRUE(axis_->Read().referenced) << "torque off does not lose the reference";
}

TEST_F(Cia402AxisTest, MoveToWhereItStands) {
  EnableAndHome();
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(axis_->StartMove(0), OkStatus());
    ASSERT_EQ(axis_->AwaitMove(Now() + seconds(1)), OkStatus());
  }
}

TEST_F(Cia402AxisTest, SoftLimitsAndPreconditions) {
  EXPECT_TRUE(absl::IsFailedPrecondition(axis_->StartMove(0)));
  ASSERT_EQ(axis_->Enable(), OkStatus());
  EXPECT_THAT(Text(axis_->StartMove(0)), HasSubstr("not referenced"));
  EnableAndHome();
  const Status beyond = axis_->StartMove(RadFromDeg(180.01));
  EXPECT_TRUE(absl::IsInvalidArgument(beyond));
  EXPECT_THAT(Text(beyond), HasSubstr("180.0100 deg is not in [-180.0000, 180.0000] deg"));
  EXPECT_TRUE(absl::IsInvalidArgument(axis_->StartMove(std::nan(""))));
  EXPECT_NEAR(WorldCounts(), 0, 0.5);
}

// A set-point that became another one on its way: the drive itself goes no further than its limits.
TEST_F(Cia402AxisTest, TheDriveHasTheSoftLimitsItself) {
  for (const int32_t offset : {15000, -35000}) {
    EnableAndHome();
    ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
    ASSERT_EQ(axis_->AwaitMove(Now() + seconds(5)), OkStatus());
    sim_.can.target_offset = offset;  // to 240 deg, to -260 deg
    ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
    sim_.can.target_offset = 0;
    const Status status = axis_->AwaitMove(Now() + seconds(10));
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    EXPECT_THAT(Text(status), HasSubstr("goes no further than its own limits (0x607D): commanded "
                                        "90.0000 deg"));
    end_.link->SleepFor(seconds(10));
    EXPECT_EQ(std::abs(std::round(WorldCounts())), 18000) << "if nobody stops it, at the limit";
    EXPECT_TRUE(absl::IsUnavailable(axis_->CheckHolds()));
    ASSERT_EQ(axis_->StartMove(RadFromDeg(180)), OkStatus());
    EXPECT_EQ(axis_->AwaitMove(Now() + seconds(10)), OkStatus()) << "the limit itself is permitted";
    ASSERT_EQ(axis_->Disable(), OkStatus());
  }
}

TEST_F(Cia402AxisTest, LimitsAreReadBack) {
  sim_.can.deaf_index = 0x607D;
  const Status deaf = axis_->Enable();
  EXPECT_TRUE(absl::IsUnavailable(deaf)) << deaf;
  EXPECT_THAT(Text(deaf), HasSubstr("axis turntable (node 5): software position limit: min reads "
                                    "back as 0 counts (0.0000 deg), -18000 counts (-180.0000 deg)"));
  sim_.can.deaf_index = 0;
  sim_.can.abort_code = 0x06020000;
  sim_.can.abort_index = 0x607D;
  EXPECT_THAT(Text(axis_->Enable()), HasSubstr("0x607D:1 (software position limit: min): aborted"));
  EXPECT_FALSE(TorqueOn());
  sim_.can.abort_index = 0;
  EXPECT_EQ(axis_->Enable(), OkStatus());
}

TEST_F(Cia402AxisTest, NoAnswerEndsAtItsDeadlineInVirtualTime) {
  sim_.can.mute = true;
  const RigTime start = Now();
  const Status status = axis_->Enable();
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  EXPECT_THAT(Text(status), HasSubstr("axis turntable (node 5): reading 0x6041:0 (statusword): no "
                                      "answer within 0.5 s"));
  EXPECT_NEAR(Seconds(Now() - start), 0.5, 0.001);
  sim_.can.mute = false;
  EXPECT_EQ(axis_->Enable(), OkStatus()) << "and works when the node is back";
}

TEST_F(Cia402AxisTest, SdoAbortIsTold) {
  sim_.can.abort_code = 0x06090030;
  sim_.can.abort_index = 0x6081;
  const Status status = axis_->Enable();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(
      Text(status),
      HasSubstr("writing 0x6081:0 (profile velocity): aborted with 0x06090030 (value out of "
                "range)"));
}

TEST_F(Cia402AxisTest, DriveFaultMidMoveNamesTheEmergency) {
  EnableAndHome();
  sim_.Exclusive([&](RigTime now) {
    sim_.hand.At(now + milliseconds(400), [&](RigTime t) { sim_.contactor.SetChain(false, t); });
  });
  const RigTime start = Now();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
  const Status status = axis_->AwaitMove(Now() + seconds(5));
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(Text(status), HasSubstr("drive fault 0x3130 (mains voltage"));
  EXPECT_NEAR(Seconds(Now() - start), 0.4, 0.01);
  EXPECT_TRUE(axis_->Read().fault);
  EXPECT_EQ(axis_->QuickStop(), OkStatus());
  EXPECT_EQ(axis_->Disable(), OkStatus());
  // Without power the fault stays; with it, a reset and the old reference do.
  EXPECT_TRUE(absl::IsFailedPrecondition(axis_->Enable()));
  sim_.Exclusive([&](RigTime now) {
    sim_.contactor.SetChain(true, now);
    sim_.contactor.ResetEdge(now);
  });
  EXPECT_EQ(axis_->Enable(), OkStatus());
  EXPECT_TRUE(TorqueOn());
  EXPECT_EQ(axis_->StartMove(RadFromDeg(10)), OkStatus());
  EXPECT_EQ(axis_->AwaitMove(Now() + seconds(5)), OkStatus());
}

TEST_F(Cia402AxisTest, QuickStopStopsSoonAndTorqueGoesOff) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(170)), OkStatus());
  end_.link->SleepFor(milliseconds(800));
  const double at = WorldCounts();
  ASSERT_EQ(axis_->QuickStop(), OkStatus());
  ASSERT_EQ(axis_->Disable(), OkStatus());
  EXPECT_FALSE(TorqueOn());
  const double stopped = WorldCounts();
  EXPECT_GT(stopped, at);
  EXPECT_LT(stopped - at, 1200) << "90 deg/s at four times 180 deg/s^2: 5.6 deg";
  end_.link->SleepFor(seconds(2));
  EXPECT_EQ(WorldCounts(), stopped);
}

TEST_F(Cia402AxisTest, StopEndsEveryWait) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
  end_.stop.Raise("enough");
  const RigTime then = Now();
  const Status status = axis_->AwaitMove(Now() + seconds(5));
  EXPECT_TRUE(absl::IsCancelled(status));
  EXPECT_EQ(Text(status), "enough");
  EXPECT_EQ(Now(), then);
  EXPECT_EQ(axis_->QuickStop(), OkStatus());
  EXPECT_EQ(axis_->Disable(), OkStatus());
  EXPECT_FALSE(TorqueOn());
}

TEST_F(Cia402AxisTest, AwaitMoveEndsAtItsDeadline) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(90)), OkStatus());
  const RigTime deadline = Now() + milliseconds(300);
  EXPECT_TRUE(absl::IsDeadlineExceeded(axis_->AwaitMove(deadline)));
  EXPECT_EQ(Now(), deadline);
}

TEST_F(Cia402AxisTest, DriveThatMissesTheDaemonsHeartbeatFaults) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(170)), OkStatus());
  sim_.can.mute = true;  // the daemon's heartbeats no longer arrive: as if it had died
  const Status status = axis_->AwaitMove(Now() + seconds(5));
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_THAT(Text(status), HasSubstr("drive fault 0x8130 (heartbeat lost)"));
  EXPECT_TRUE(axis_->Read().fault);
  EXPECT_FALSE(TorqueOn());
  const double at = WorldCounts();
  end_.link->SleepFor(seconds(2));
  EXPECT_LT(std::abs(WorldCounts() - at), 1200) << "braked, not run on to 170 deg";
}

TEST(CanOpenText, EmergenciesFallBackToTheirClass) {
  EXPECT_EQ(EmergencyText(0x8130), "0x8130 (heartbeat lost)");
  EXPECT_EQ(EmergencyText(0x4377), "0x4377 (temperature of the drive)");
  EXPECT_EQ(EmergencyText(0x2ABC), "0x2ABC (current)");
  EXPECT_EQ(SdoAbortText(0x06020000), "0x06020000 (object does not exist)");
  EXPECT_EQ(SdoAbortText(0x12345678), "0x12345678");
}

TEST(CanOpenText, StatesOfTheTable) {
  EXPECT_EQ(StateOf(0x0250), DriveState::kSwitchOnDisabled);
  EXPECT_EQ(StateOf(0x0231), DriveState::kReadyToSwitchOn);
  EXPECT_EQ(StateOf(0x0233), DriveState::kSwitchedOn);
  EXPECT_EQ(StateOf(0x1637), DriveState::kOperationEnabled);
  EXPECT_EQ(StateOf(0x0617), DriveState::kQuickStopActive);
  EXPECT_EQ(StateOf(0x0218), DriveState::kFault);
  EXPECT_EQ(StateOf(0x021F), DriveState::kFaultReactionActive);
}

}  // namespace
}  // namespace mesorig::daemon::cia402
