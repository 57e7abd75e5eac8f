// SocketCanPort against the kernel: vcan0, with cansend and candump (can-utils) as witnesses.

#include <gmock/gmock.h>
#include <linux/can/error.h>
#include <sys/wait.h>
#include <unistd.h>

#include <vector>

#include "daemon/bus/socketcan_port.h"
#include "tests/hil/shell.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;
using hil::Eventually;
using hil::Shell;

class SocketCan : public ::testing::Test {
 protected:
  void SetUp() override {
    Shell("ip link set vcan0 up");
    auto port = SocketCanPort::Open(clock_, "vcan0");
    ASSERT_TRUE(port.ok()) << port.status();
    port_ = *std::move(port);
    ASSERT_TRUE(port_->Health().ok()) << port_->Health();
    port_->OnFrame([this](RigTime, const CanFrame& frame) { came_.push_back(frame); });
  }
  std::vector<CanFrame> Came() {
    std::vector<CanFrame> came;
    clock_.Read([&] { came = came_; });
    return came;
  }
  bool CameToBe(size_t count) {
    return Eventually([&] { return Came().size() == count; });
  }

  SystemRigClock clock_;
  std::vector<CanFrame> came_;  // guarded by the clock's lock
  std::unique_ptr<SocketCanPort> port_;
};

TEST_F(SocketCan, WhatCansendSendsComes) {
  Shell("cansend vcan0 123#0102030405060708; cansend vcan0 7FF#; cansend vcan0 080#FF");
  ASSERT_TRUE(CameToBe(3));
  EXPECT_EQ(Came()[0], (CanFrame{0x123, 8, {1, 2, 3, 4, 5, 6, 7, 8}}));
  EXPECT_EQ(Came()[1], (CanFrame{0x7FF, 0, {}}));
  EXPECT_EQ(Came()[2], (CanFrame{0x080, 1, {0xFF}}));
}

TEST_F(SocketCan, ForeignFramesAreLeftOutByTheKernel) {
  Shell("cansend vcan0 00000123#11; cansend vcan0 123#R; cansend vcan0 181#42");
  ASSERT_TRUE(CameToBe(1));
  EXPECT_EQ(Came()[0].id, 0x181);
  EXPECT_EQ(port_->figures().foreign, 0u) << "filtered before they came";
}

TEST_F(SocketCan, WhatIsSentCandumpSees) {
  std::string seen;
  std::thread witness([&] { seen = Shell("timeout 10 candump -n 3 -L vcan0"); });
  ASSERT_TRUE(Eventually(hil::CandumpListens));
  ASSERT_EQ(port_->Send({0x67F, 8, {0x40, 0x41, 0x60, 0, 0, 0, 0, 0}}), OkStatus());
  ASSERT_EQ(port_->Send({0x000, 2, {1, 5}}), OkStatus());
  ASSERT_EQ(port_->Send({0x77F, 1, {5}}), OkStatus());
  witness.join();
  EXPECT_THAT(seen, HasSubstr("vcan0 67F#4041600000000000"));
  EXPECT_THAT(seen, HasSubstr("vcan0 000#0105"));
  EXPECT_THAT(seen, HasSubstr("vcan0 77F#05"));
  EXPECT_TRUE(Came().empty()) << "our own frames do not come back";
  EXPECT_EQ(port_->figures().sent, 3u);
  EXPECT_TRUE(absl::IsInvalidArgument(port_->Send({0x800, 0, {}})));
}

TEST_F(SocketCan, OrderAndCountOfManyFrames) {
  Shell("for i in $(seq 0 29); do printf '100#%02X\\n' $i; done | while read f; do cansend vcan0 $f; done");
  ASSERT_TRUE(CameToBe(30));
  for (uint8_t i = 0; i < 30; ++i) EXPECT_EQ(Came()[i].data[0], i);
  EXPECT_EQ(port_->figures().lost, 0u);
}

// A virtual interface never goes bus-off by itself: the controller's words are put on it by hand.
TEST_F(SocketCan, BusOffIsToldAndSendsNothingUntilTheRestart) {
  const auto say = [](const std::string& id, const std::string& data) {
    Shell("cansend vcan0 " + id + "#" + data);
  };
  say("20000004", "0010000000000000");  // CAN_ERR_CRTL: error-passive (transmit: 0x20, receive: 0x10)
  ASSERT_TRUE(Eventually([&] { return port_->figures().trouble == CanTrouble::kPassive; }));
  EXPECT_TRUE(port_->Health().ok()) << "it takes part still";
  say("20000040", "0000000000000000");  // CAN_ERR_BUSOFF
  ASSERT_TRUE(Eventually([&] { return !port_->Health().ok(); }));
  EXPECT_THAT(std::string(Message(port_->Send({0x77F, 1, {5}}))), HasSubstr("CAN vcan0: the controller is bus-off"));
  say("20000100", "0000000000000000");  // CAN_ERR_RESTARTED
  ASSERT_TRUE(Eventually([&] { return port_->Health().ok(); }));
  EXPECT_EQ(port_->Send({0x77F, 1, {5}}), OkStatus());
  EXPECT_EQ(port_->figures().bus_off, 1u);
  EXPECT_EQ(port_->figures().error_frames, 3u);
  EXPECT_TRUE(Came().empty()) << "no error is data";
}

TEST_F(SocketCan, AnInterfaceThatGoesDownAndComesBack) {
  Shell("ip link set vcan0 down");
  ASSERT_TRUE(Eventually([&] { return !port_->Health().ok(); }));
  EXPECT_THAT(std::string(Message(port_->Send({0x77F, 1, {5}}))), HasSubstr("CAN vcan0"));
  Shell("ip link set vcan0 up");
  ASSERT_TRUE(Eventually([&] { return port_->Health().ok(); }));
  Shell("cansend vcan0 185#01");
  ASSERT_TRUE(CameToBe(1));
  // The adapter is unplugged, and plugged in again.
  Shell("ip link del vcan0");
  ASSERT_TRUE(Eventually([&] { return !port_->Health().ok(); }));
  Shell("ip link add vcan0 type vcan; ip link set vcan0 up");
  ASSERT_TRUE(Eventually([&] { return port_->Health().ok(); }));
  Shell("cansend vcan0 185#02");
  ASSERT_TRUE(CameToBe(2));
  EXPECT_EQ(port_->figures().reconnects, 2u);
}

TEST_F(SocketCan, OneProcessHasAnInterface) {
  const auto second = SocketCanPort::Open(clock_, "vcan0").status();
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
  EXPECT_THAT(std::string(Message(second)),
              HasSubstr(fmt::format("CAN vcan0 is in use by process {} (hil_bus_test)", ::getpid())));
  port_.reset();
  EXPECT_TRUE(SocketCanPort::Open(clock_, "vcan0").ok());
}

TEST(SocketCanNames, ThatAreNone) {
  SystemRigClock clock;
  EXPECT_TRUE(absl::IsNotFound(SocketCanPort::Open(clock, "can7").status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(SocketCanPort::Open(clock, "lo").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(SocketCanPort::Open(clock, "").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(SocketCanPort::Open(clock, std::string(16, 'x')).status()));
}

}  // namespace
}  // namespace mesorig::daemon
