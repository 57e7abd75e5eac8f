#include "daemon/safety/laser_gate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/fake_devices.h"
#include "tests/daemon/fakes/fake_rig_clock.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

constexpr int kTrigger = 3, kOn = 4;

// The test's thread is the sequencer's.
class LaserGateTest : public ::testing::Test {
 protected:
  LaserGateTest() { lines_.AddOneShot(kTrigger, kOn); }
  FakeRigClock clock_;
  RigClock::Member member_{clock_, "test"};
  RigClock::Activity activity_{clock_, Pace::kFree};
  StopFlag stop_{clock_};
  FakeLines lines_{clock_};
  LaserGate gate_{clock_, &lines_, Lines{0, 1, 2, kTrigger, kOn}, stop_};
};

TEST_F(LaserGateTest, HoldsTheLaserOnWhileThereIsProgress) {
  EXPECT_FALSE(gate_.Shines().value());
  ASSERT_EQ(gate_.Open(), OkStatus());
  for (int i = 0; i < 50; ++i) {
    clock_.SleepFor(std::chrono::milliseconds(133));
    EXPECT_TRUE(gate_.Shines().value()) << i;
    gate_.Progress();
  }
  EXPECT_NEAR(lines_.edges(), 6.65 / LaserGate::kPetPeriod_s, 2);
  const RigTime before = clock_.Now();
  EXPECT_EQ(gate_.Close(), OkStatus());
  EXPECT_FALSE(gate_.Shines().value());
  EXPECT_LE(Seconds(clock_.Now() - before), kLaserOneShot_s + 0.02);
}

TEST_F(LaserGateTest, HungSequencerMeansDark) {
  ASSERT_EQ(gate_.Open(), OkStatus());
  clock_.SleepFor(
      FromSeconds(LaserGate::kProgressLimit_s + kLaserOneShot_s + 2 * LaserGate::kPetPeriod_s));
  EXPECT_FALSE(gate_.Shines().value());
  const int edges = lines_.edges();
  gate_.Progress();  // too late: only Open lights it again
  clock_.SleepFor(std::chrono::seconds(1));
  EXPECT_EQ(lines_.edges(), edges);
  ASSERT_EQ(gate_.Open(), OkStatus());
  EXPECT_TRUE(gate_.Shines().value());
}

TEST_F(LaserGateTest, StopEndsTheEdges) {
  ASSERT_EQ(gate_.Open(), OkStatus());
  stop_.Raise("a hand said stop");
  clock_.SleepFor(FromSeconds(kLaserOneShot_s));
  EXPECT_FALSE(gate_.Shines().value());
  EXPECT_TRUE(absl::IsCancelled(gate_.Open()));
}

TEST_F(LaserGateTest, LaserThatDoesNotObeyIsAnError) {
  lines_.AddOneShot(-2, kOn);  // no edge reaches it
  const Status dark = gate_.Open();
  EXPECT_TRUE(absl::IsUnavailable(dark));
  EXPECT_THAT(std::string(Message(dark)), HasSubstr("line 4 says off"));
  EXPECT_EQ(gate_.Close(), OkStatus());
  lines_.AddOneShot(kTrigger, -2);  // reads as an input that is closed: on for ever
  EXPECT_THAT(std::string(Message(gate_.Close())), HasSubstr("line 4 says on"));
}

TEST_F(LaserGateTest, BrokenChipIsNoLight) {
  lines_.Break();
  EXPECT_FALSE(gate_.Shines().ok());
  EXPECT_FALSE(gate_.Open().ok());
}

}  // namespace
}  // namespace mesorig::daemon
