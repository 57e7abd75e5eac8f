// The drive against the tables of CiA 301 and CiA 402, byte by byte.

#include "simulator/devices/cia402_node/cia402_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "simulator/devices/cia402_node/can_bus.h"
#include "tests/fixtures/small_rig.h"

namespace mesorig::simulator {
namespace {

using fixtures::SmallRig;
using sim_wire::CanFrame;
using std::chrono::milliseconds;

constexpr double kPowerOnCounts = 1234;

class NodeTest : public ::testing::Test {
 protected:
  NodeTest() : rig_(SmallRig()), node_(rig_.axes[0], kPowerOnCounts) {}

  std::vector<CanFrame> Send(CanFrame frame) {
    node_.Receive(frame, now_);
    return node_.TakeOutput();
  }
  CanFrame Sdo(std::array<uint8_t, 8> data) {
    for (const CanFrame& frame : Send({0x605, 8, data})) {
      if (frame.id == 0x585) return frame;
    }
    ADD_FAILURE() << "no SDO answer";
    return {};
  }
  void Write(uint16_t index, uint8_t sub, int size, uint32_t value) {
    const auto command = static_cast<uint8_t>(0x23 | (4 - size) << 2);
    const CanFrame reply = Sdo({command, static_cast<uint8_t>(index), static_cast<uint8_t>(index >> 8),
                                sub, static_cast<uint8_t>(value), static_cast<uint8_t>(value >> 8),
                                static_cast<uint8_t>(value >> 16), static_cast<uint8_t>(value >> 24)});
    EXPECT_EQ(reply.data[0], 0x60) << fmt::format("{:04x}:{}", index, sub);
  }
  uint32_t Read(uint16_t index, uint8_t sub = 0) {
    const CanFrame reply =
        Sdo({0x40, static_cast<uint8_t>(index), static_cast<uint8_t>(index >> 8), sub, 0, 0, 0, 0});
    uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value |= uint32_t{reply.data[4 + i]} << (8 * i);
    return value;
  }
  std::vector<CanFrame> Command(uint16_t controlword, int32_t target = 0) {
    const auto t = static_cast<uint32_t>(target);
    return Send({0x405, 6, {static_cast<uint8_t>(controlword), static_cast<uint8_t>(controlword >> 8),
                            static_cast<uint8_t>(t), static_cast<uint8_t>(t >> 8),
                            static_cast<uint8_t>(t >> 16), static_cast<uint8_t>(t >> 24)}});
  }
  uint16_t Status() { return static_cast<uint16_t>(Read(0x6041)); }
  void StartUp() {
    Send({0x000, 2, {0x01, 0x05}});
    Command(0x06);
    Command(0x07);
    Command(0x0F);
    ASSERT_EQ(Status() & 0x6F, 0x27);
  }
  // Runs all events up to `end`.
  std::vector<CanFrame> RunUntil(RigTime end) {
    std::vector<CanFrame> said;
    while (node_.NextEvent() <= end) {
      now_ = node_.NextEvent();
      node_.RunEvent(now_);
      for (const auto& frame : node_.TakeOutput()) said.push_back(frame);
    }
    now_ = end;
    return said;
  }
  void HomeTheAxis() {
    Write(0x6060, 0, 1, 6);
    Command(0x1F);
    RunUntil(now_ + std::chrono::seconds(60));
    ASSERT_EQ(Status() & 0x1400, 0x1400) << "homing attained, target reached";
    Command(0x0F);
    Write(0x6060, 0, 1, 1);
  }
  Rig rig_;
  Cia402Node node_;
  RigTime now_{};
};

TEST_F(NodeTest, StateMachineFollowsTheCommandTable) {
  EXPECT_EQ(Status() & 0x4F, 0x40) << "switch on disabled";
  Send({0x000, 2, {0x01, 0x00}});
  Command(0x06);
  EXPECT_EQ(Status() & 0x6F, 0x21) << "ready to switch on";
  Command(0x07);
  EXPECT_EQ(Status() & 0x6F, 0x23) << "switched on";
  Command(0x0F);
  EXPECT_EQ(Status() & 0x6F, 0x27) << "operation enabled";
  Command(0x00);
  EXPECT_EQ(Status() & 0x4F, 0x40) << "disable voltage";
}

TEST_F(NodeTest, SdoAbortCodes) {
  EXPECT_EQ(Read(0x1000) & 0xFFFF, 402u);
  const CanFrame none = Sdo({0x40, 0x34, 0x12, 0, 0, 0, 0, 0});
  EXPECT_EQ(none.data[0], 0x80);
  EXPECT_EQ(none.data[7] << 24 | none.data[6] << 16, 0x06020000);
  const CanFrame read_only = Sdo({0x23, 0x64, 0x60, 0, 1, 0, 0, 0});
  EXPECT_EQ(read_only.data[4], 0x02);
  const CanFrame short_one = Sdo({0x2F, 0x81, 0x60, 0, 1, 0, 0, 0});
  EXPECT_EQ(short_one.data[0], 0x80);
  EXPECT_EQ(short_one.data[6], 0x07);
}

TEST_F(NodeTest, HomesOntoTheSwitchAndThenKnowsWhereItIs) {
  EXPECT_EQ(static_cast<int32_t>(Read(0x6064)), 0) << "before homing the encoder lies";
  EXPECT_EQ(node_.WorldCounts(now_), kPowerOnCounts);
  StartUp();
  HomeTheAxis();
  EXPECT_EQ(node_.WorldCounts(now_), 0);
  EXPECT_EQ(static_cast<int32_t>(Read(0x6064)), 0);
}

TEST_F(NodeTest, ProfilePositionHandshakeAndTime) {
  StartUp();
  HomeTheAxis();
  const RigTime start = now_;
  Command(0x1F, -9000);
  EXPECT_NE(Status() & 0x1000, 0) << "set-point acknowledged";
  EXPECT_EQ(Status() & 0x0400, 0) << "not there yet";
  Command(0x0F, -9000);
  EXPECT_EQ(Status() & 0x1000, 0) << "acknowledge falls with the bit";
  RunUntil(start + milliseconds(1499));
  EXPECT_EQ(Status() & 0x0400, 0);
  // 90 degrees at 90 deg/s and 180 deg/s^2: 1 s + 0.5 s.
  const auto said = RunUntil(start + milliseconds(1501));
  EXPECT_NE(Status() & 0x0400, 0);
  EXPECT_EQ(static_cast<int32_t>(Read(0x6064)), -9000);
  EXPECT_EQ(node_.WorldCounts(now_), -9000);
  ASSERT_FALSE(said.empty()) << "the end is told by itself";
  EXPECT_EQ(said.back().id, 0x385);
}

TEST_F(NodeTest, GoesNoFurtherThanItsSoftwareLimits) {
  Write(0x607D, 1, 4, static_cast<uint32_t>(-500));
  Write(0x607D, 2, 4, 700);
  StartUp();
  HomeTheAxis();  // (from 1234 counts: the switch is sought wherever it is)
  EXPECT_EQ(Status() & 0x0800, 0);
  const struct {
    int32_t target, reached;
  } cases[] = {{700, 700}, {701, 700}, {-500, -500}, {-0x7FFFFFFF, -500}, {0x7FFFFFFF, 700}, {0, 0}};
  for (const auto& [target, reached] : cases) {
    Command(0x1F, target);
    EXPECT_EQ((Status() & 0x0800) != 0, target != reached) << target << ": internal limit active";
    Command(0x0F, target);
    RunUntil(now_ + std::chrono::seconds(10));
    EXPECT_EQ(static_cast<int32_t>(Read(0x6064)), reached) << target;
    EXPECT_NE(Status() & 0x0400, 0);
  }
  Command(0x5F, 650);  // relative
  Command(0x4F, 650);
  RunUntil(now_ + std::chrono::seconds(10));
  Command(0x5F, 650);
  EXPECT_NE(Status() & 0x0800, 0);
  RunUntil(now_ + std::chrono::seconds(10));
  EXPECT_EQ(node_.WorldCounts(now_), 700);
  Command(0x00);
  EXPECT_EQ(Status() & 0x0800, 0);
  Write(0x607D, 2, 4, static_cast<uint32_t>(-500));  // min not below max: none
  Command(0x06);
  Command(0x07);
  Command(0x0F);
  Command(0x1F, 5000);
  EXPECT_EQ(Status() & 0x0800, 0);
  RunUntil(now_ + std::chrono::seconds(10));
  EXPECT_EQ(node_.WorldCounts(now_), 5000);
}

TEST_F(NodeTest, DoesNotMoveUnlessEnabled) {
  Send({0x000, 2, {0x01, 0x05}});
  Command(0x1F, 5000);
  RunUntil(std::chrono::seconds(10));
  EXPECT_EQ(node_.WorldCounts(now_), kPowerOnCounts);
}

TEST_F(NodeTest, QuickStopBrakesAndDisables) {
  StartUp();
  HomeTheAxis();
  Command(0x1F, 18000);
  RunUntil(now_ + milliseconds(800));
  const double before = node_.WorldCounts(now_);
  Command(0x0002);
  RunUntil(now_ + std::chrono::seconds(2));
  EXPECT_EQ(Status() & 0x4F, 0x40);
  // v^2 / 2a with a = 4 * 180 deg/s^2 and v = 90 deg/s: 5.6 degrees.
  EXPECT_NEAR(node_.WorldCounts(now_) - before, 562.5, 2);
}

TEST_F(NodeTest, LostHeartbeatActsByTheAbortOption) {
  Write(0x1016, 1, 4, 0x7F << 16 | 500);
  Write(0x6007, 0, 2, 3);
  StartUp();
  HomeTheAxis();
  Command(0x1F, 18000);
  Send({0x77F, 1, {5}});
  RunUntil(now_ + milliseconds(499));
  EXPECT_EQ(Status() & 0x6F, 0x27);
  RunUntil(now_ + std::chrono::seconds(3));
  EXPECT_EQ(Status() & 0x4F, 0x40) << "quick-stopped, torque off";
  EXPECT_LT(node_.WorldCounts(now_), 18000);
}

TEST_F(NodeTest, HeartbeatIsProducedWithTheNmtState) {
  Write(0x1017, 0, 2, 100);
  const auto before = RunUntil(now_ + milliseconds(100));
  ASSERT_EQ(before.size(), 1u);
  EXPECT_EQ(before[0], (CanFrame{0x705, 1, {0x7F}}));
  Send({0x000, 2, {0x01, 0x05}});
  EXPECT_EQ(RunUntil(now_ + milliseconds(300)).size(), 3u);
}

TEST_F(NodeTest, PowerLossIsAFaultThatNeedsAReset) {
  StartUp();
  HomeTheAxis();
  Command(0x1F, 18000);
  RunUntil(now_ + milliseconds(700));
  node_.SetPower(false, now_);
  const auto said = node_.TakeOutput();
  EXPECT_EQ(Status() & 0x4F, 0x08);
  ASSERT_FALSE(said.empty());
  EXPECT_EQ(said[0].id, 0x085) << "emergency";
  const double stands = node_.WorldCounts(now_);
  RunUntil(now_ + std::chrono::seconds(5));
  EXPECT_EQ(node_.WorldCounts(now_), stands);
  Command(0x80);
  EXPECT_EQ(Status() & 0x4F, 0x08) << "no reset without power";
  node_.SetPower(true, now_);
  Command(0x00);
  Command(0x80);
  EXPECT_EQ(Status() & 0x4F, 0x40);
}

// Whatever arrives on the bus, the drive stays within its rules.
TEST_F(NodeTest, SurvivesRandomFrames) {
  std::mt19937 random(3);
  const uint16_t ids[] = {0x000, 0x605, 0x405, 0x77F, 0x080, 0x606};
  for (int i = 0; i < 50000; ++i) {
    CanFrame frame{ids[random() % 6], static_cast<uint8_t>(random() % 9), {}};
    for (uint8_t& byte : frame.data) byte = static_cast<uint8_t>(random() % 3 == 0 ? random() : 0);
    if (frame.id == 0x605) {
      frame.data[0] = random() % 2 != 0 ? 0x40 : 0x23;
      frame.data[2] = 0x60;
    }
    Send(frame);
    if (random() % 4 == 0) RunUntil(now_ + milliseconds(random() % 200));
    ASSERT_TRUE(std::isfinite(node_.WorldCounts(now_)));
  }
}

TEST(CanBusDevice, PowerOnPositionsFollowTheSeed) {
  const Rig rig = SmallRig();
  Contactor contactor;
  CanBusDevice a(rig, 1, contactor), same(rig, 1, contactor), other(rig, 2, contactor);
  EXPECT_EQ(a.node(0).WorldCounts(RigTime(0)), same.node(0).WorldCounts(RigTime(0)));
  EXPECT_NE(a.node(0).WorldCounts(RigTime(0)), other.node(0).WorldCounts(RigTime(0)));
  EXPECT_LE(std::abs(a.node(0).WorldCounts(RigTime(0))), 2000);
}

}  // namespace
}  // namespace mesorig::simulator
