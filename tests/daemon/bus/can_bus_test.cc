#include "daemon/bus/can_bus.h"

#include <gtest/gtest.h>

#include "tests/daemon/fakes/fake_can_port.h"
#include "tests/daemon/fakes/fake_rig_clock.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;

TEST(CanBus, SendsItsHeartbeatOnlyWhileTimePasses) {
  FakeRigClock clock;
  FakeCanPort port(clock, nullptr);
  CanBusOptions options;
  options.heartbeat = milliseconds(500);
  CanBus bus(clock, port, options);
  RigClock::Member member(clock, "test");
  EXPECT_TRUE(port.sent().empty());
  {
    RigClock::Activity activity(clock, Pace::kFree);
    clock.SleepFor(milliseconds(2250));
  }
  const auto sent = port.sent();
  ASSERT_EQ(sent.size(), 5u);  // just after 0, 0.5, 1, 1.5, 2 s
  for (const CanFrame& frame : sent) EXPECT_EQ(frame, (CanFrame{0x77F, 1, {0x05}}));
}

TEST(CanBus, HandsFramesToTheirSubscribersInOrder) {
  FakeRigClock clock;
  FakeCanPort port(clock, nullptr);
  CanBus bus(clock, port, {});
  std::vector<uint8_t> a, b;
  bus.Subscribe(0x385, [&](RigTime, const CanFrame& frame) { a.push_back(frame.data[0]); });
  bus.Subscribe(0x386, [&](RigTime, const CanFrame& frame) { b.push_back(frame.data[0]); });
  for (uint8_t i = 0; i < 50; ++i) {
    port.Deliver({static_cast<uint16_t>(0x385 + i % 3), 1, {i}});  // 0x387 has no subscriber
  }
  RigClock::Member member(clock, "test");
  RigClock::Activity activity(clock, Pace::kFree);
  ASSERT_TRUE(clock.WaitFor(milliseconds(1), [&] { return a.size() == 17 && b.size() == 17; }));
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i], 3 * i);
    EXPECT_EQ(b[i], 3 * i + 1);
  }
  bus.Unsubscribe(0x385);
  port.Deliver({0x385, 1, {1}});
  clock.SleepFor(milliseconds(1));
  EXPECT_EQ(a.size(), 17u);
}

}  // namespace
}  // namespace mesorig::daemon
