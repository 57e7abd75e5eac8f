// The cia402 driver over the kernel's CAN interface, with the simulated drives on the other side of
// it (mesorig-sim run and bridge, started by job.sh), in real time. candump is the witness.

#include <gmock/gmock.h>

#include <fstream>
#include <sstream>

#include "daemon/bus/can_bus.h"
#include "daemon/bus/socketcan_port.h"
#include "daemon/drivers/driver.h"
#include "protocol/rig/rig.h"
#include "tests/hil/shell.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using hil::Eventually;
using hil::Shell;
using std::chrono::seconds;

class CanAxis : public ::testing::Test {
 protected:
  void SetUp() override {
    auto rig = LoadRig("/job/source/rigs/demo.toml");
    ASSERT_TRUE(rig.ok()) << rig.status();
    rig_ = *std::move(rig);
    Shell("ip link set vcan0 up");
    auto port = SocketCanPort::Open(clock_, "vcan0");
    ASSERT_TRUE(port.ok()) << port.status();
    port_ = *std::move(port);
    CanBusOptions options;
    options.heartbeat = FromSeconds(rig_.heartbeat_s);
    bus_ = std::make_unique<CanBus>(clock_, *port_, options);
    context_.clock = &clock_;
    context_.rig = &rig_;
    context_.stop = &stop_;
    context_.can = bus_.get();
    auto axis = MakeAxis("cia402", context_, 0);
    ASSERT_TRUE(axis.ok()) << axis.status();
    axis_ = *std::move(axis);
  }
  void TearDown() override {
    if (axis_) {
      EXPECT_EQ(axis_->Disable(), OkStatus());
    }
  }
  void EnableAndHome() {
    ASSERT_EQ(axis_->Enable(), OkStatus());
    ASSERT_EQ(axis_->StartHoming(), OkStatus());
    ASSERT_EQ(axis_->AwaitHoming(clock_.Now() + seconds(60)), OkStatus());
  }

  SystemRigClock clock_;
  Rig rig_;
  StopFlag stop_{clock_};
  DriverContext context_;
  std::unique_ptr<SocketCanPort> port_;
  std::unique_ptr<CanBus> bus_;
  std::unique_ptr<Axis> axis_;
  RigClock::Member member_{clock_, "test"};
};

TEST_F(CanAxis, HomesAndMovesAndTheWitnessSawWhatWasSaid) {
  std::string seen;
  std::thread witness([&] { seen = Shell("timeout 120 candump -L vcan0"); });
  ASSERT_TRUE(Eventually(hil::CandumpListens));
  EnableAndHome();
  EXPECT_TRUE(axis_->Read().referenced);
  ASSERT_EQ(axis_->StartMove(RadFromDeg(20)), OkStatus());
  ASSERT_EQ(axis_->AwaitMove(clock_.Now() + seconds(30)), OkStatus());
  EXPECT_NEAR(DegFromRad(axis_->Read().position_rad), 20, 0.02);
  EXPECT_EQ(axis_->CheckHolds(), OkStatus());
  EXPECT_EQ(axis_->Disable(), OkStatus());
  Shell("pkill candump");
  witness.join();
  EXPECT_THAT(seen, HasSubstr("vcan0 000#01")) << "NMT: start";
  EXPECT_THAT(seen, HasSubstr("vcan0 601#2F606000")) << "SDO: mode of operation";
  EXPECT_THAT(seen, HasSubstr("vcan0 581#60606000")) << "and its answer";
  EXPECT_EQ(port_->figures().foreign, 0u);
  EXPECT_EQ(port_->figures().lost, 0u);
}

TEST_F(CanAxis, AQuickStopBrakes) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(300)), OkStatus());
  ASSERT_TRUE(Eventually([&] { return axis_->Read().position_rad > RadFromDeg(5); }));
  ASSERT_EQ(axis_->QuickStop(), OkStatus());
  ASSERT_TRUE(Eventually([&] { return !axis_->Read().moving; }));
  EXPECT_LT(DegFromRad(axis_->Read().position_rad), 280);
  EXPECT_FALSE(axis_->CheckHolds().ok());
}

// The cable is out while it moves: the daemon is told, the drive's own watch stops it, and when the
// interface is back the axis homes and goes on, in the same process.
TEST_F(CanAxis, AnInterfaceThatGoesDownWhileItMoves) {
  EnableAndHome();
  ASSERT_EQ(axis_->StartMove(RadFromDeg(300)), OkStatus());
  ASSERT_TRUE(Eventually([&] { return axis_->Read().moving; }));
  Shell("ip link set vcan0 down");
  const Status lost = axis_->AwaitMove(clock_.Now() + seconds(30));
  EXPECT_FALSE(lost.ok());
  EXPECT_THAT(std::string(Message(lost)), HasSubstr("axis turntable"));
  std::this_thread::sleep_for(seconds(3));  // three heartbeats of the drive's watch, and a slow guest
  Shell("ip link set vcan0 up");
  ASSERT_TRUE(Eventually([&] { return port_->Health().ok(); }));
  Status again;
  ASSERT_TRUE(Eventually([&] {
    again = axis_->Enable();
    return again.ok();
  })) << again;
  ASSERT_EQ(axis_->StartHoming(), OkStatus());
  ASSERT_EQ(axis_->AwaitHoming(clock_.Now() + seconds(60)), OkStatus());
  EXPECT_TRUE(axis_->CheckHolds().ok());
}

}  // namespace
}  // namespace mesorig::daemon
