// What SocketCAN hands over, before it is a frame of ours; and one process for a device. (The port
// itself needs a kernel with CAN: tests/hil.)

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <unistd.h>

#include <cstring>
#include <random>

#include "daemon/bus/device_claim.h"
#include "daemon/bus/socketcan_port.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

can_frame Kernel(canid_t id, uint8_t size) {
  can_frame frame{};
  frame.can_id = id;
  frame.can_dlc = size;
  for (uint8_t i = 0; i < 8; ++i) frame.data[i] = static_cast<uint8_t>(i + 1);
  return frame;
}

TEST(SocketCanFrames, DataFramesOfElevenBits) {
  const auto frame = FromKernel(Kernel(0x581, 3));
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(*frame, (CanFrame{0x581, 3, {1, 2, 3}})) << "what is beyond its size is not its";
  EXPECT_TRUE(FromKernel(Kernel(0x7FF, 8)).ok());
  for (const can_frame& foreign : {Kernel(0x581 | CAN_EFF_FLAG, 3), Kernel(0x581 | CAN_RTR_FLAG, 0),
                                   Kernel(CAN_ERR_BUSOFF | CAN_ERR_FLAG, 8), Kernel(0x800, 1),
                                   Kernel(0x100, 9), Kernel(0x100, 255)}) {
    EXPECT_TRUE(absl::IsInvalidArgument(FromKernel(foreign).status())) << foreign.can_id;
  }
}

TEST(SocketCanFrames, AnyBytesAreAFrameOrNone) {
  std::mt19937_64 random(7);
  int frames = 0;
  for (int i = 0; i < 200'000; ++i) {
    can_frame any{};
    auto* const bytes = reinterpret_cast<unsigned char*>(&any);
    for (size_t k = 0; k < sizeof(any); ++k) bytes[k] = static_cast<unsigned char>(random());
    if (i % 2 == 0) any.can_id &= 0xFFF, any.can_dlc &= 15;
    const auto frame = FromKernel(any);
    frames += frame.ok();
    EXPECT_TRUE(!frame.ok() || (frame->id <= 0x7FF && frame->size <= 8));
    EXPECT_NE(Text(TroubleOf(any)), "unknown");
  }
  EXPECT_GT(frames, 10'000);
}

TEST(SocketCanFrames, TheWorstOfAnErrorFrameCounts) {
  const auto trouble = [](canid_t classes, uint8_t controller) {
    can_frame frame{};
    frame.can_id = classes | CAN_ERR_FLAG;
    frame.data[1] = controller;
    return TroubleOf(frame);
  };
  EXPECT_EQ(trouble(CAN_ERR_BUSOFF | CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE), CanTrouble::kBusOff);
  EXPECT_EQ(trouble(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_PASSIVE),
            CanTrouble::kOverflow);
  EXPECT_EQ(trouble(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE), CanTrouble::kPassive);
  EXPECT_EQ(trouble(CAN_ERR_ACK, 0), CanTrouble::kPassive);
  EXPECT_EQ(trouble(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING), CanTrouble::kWarning);
  EXPECT_EQ(trouble(CAN_ERR_PROT, CAN_ERR_CRTL_TX_PASSIVE), CanTrouble::kNoise)
      << "no class says that this byte means the controller";
  EXPECT_EQ(trouble(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE), CanTrouble::kNone);
  EXPECT_EQ(trouble(CAN_ERR_RESTARTED, 0), CanTrouble::kNone);
}

TEST(DeviceClaim, OneProcessHasADevice) {
  const std::string device = fmt::format("test device of {}", ::getpid());
  auto first = ClaimDevice(device);
  ASSERT_TRUE(first.ok()) << first.status();
  const Status second = ClaimDevice(device).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
  EXPECT_THAT(std::string(Message(second)), HasSubstr(fmt::format("in use by process {} (", ::getpid())));
  first->Close();
  EXPECT_TRUE(ClaimDevice(device).ok());
  EXPECT_TRUE(absl::IsInvalidArgument(ClaimDevice(std::string(200, 'x')).status()));
}

}  // namespace
}  // namespace mesorig::daemon
