#include "daemon/safety/interlock_chain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/fake_devices.h"
#include "tests/daemon/fakes/fake_rig_clock.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

class InterlockChainTest : public ::testing::Test {
 protected:
  bool Stopped() const { return !stop_.Check().ok(); }
  FakeRigClock clock_;
  StopFlag stop_{clock_};
  FakeLines lines_{clock_};
  InterlockChain chain_{clock_, &lines_, Lines{0, 1, 2}, stop_};
};

TEST_F(InterlockChainTest, ReadsLevels) {
  EXPECT_EQ(chain_.Check(), OkStatus());
  EXPECT_TRUE(chain_.levels().estop);
  lines_.Set(1, false);
  const Status open = chain_.Check();
  EXPECT_TRUE(absl::IsFailedPrecondition(open));
  EXPECT_THAT(std::string(Message(open)), HasSubstr("door (line 1) is open"));
  EXPECT_TRUE(chain_.levels().estop);
  EXPECT_FALSE(chain_.levels().door);
  lines_.Set(1, true);
  EXPECT_EQ(chain_.Check(), OkStatus());
}

TEST_F(InterlockChainTest, UnarmedOpeningStopsNothing) {
  lines_.Set(0, false);
  EXPECT_FALSE(Stopped());
  EXPECT_EQ(chain_.Opening(), OkStatus());
}

TEST_F(InterlockChainTest, ArmedOpeningIsLatchedAndFirstOneCounts) {
  chain_.Arm();
  lines_.Set(1, false);
  lines_.Set(1, true);
  lines_.Set(0, false);
  EXPECT_TRUE(Stopped());
  EXPECT_THAT(std::string(Message(chain_.Opening())), HasSubstr("door (line 1) opened"));
  chain_.Disarm();
  EXPECT_FALSE(chain_.Opening().ok()) << "until it is armed again";
  chain_.Arm();
  EXPECT_EQ(chain_.Opening(), OkStatus());
}

TEST_F(InterlockChainTest, OtherLinesAndClosingEdgesAreNoOpening) {
  chain_.Arm();
  lines_.Set(2, false);
  lines_.Set(0, true);
  EXPECT_FALSE(Stopped());
}

TEST_F(InterlockChainTest, FailedReadIsOpen) {
  chain_.Arm();
  lines_.Break();
  EXPECT_TRUE(absl::IsFailedPrecondition(chain_.Check()));
  EXPECT_TRUE(Stopped());
  EXPECT_FALSE(chain_.levels().estop);
}

TEST(InterlockChain, RigWithoutLinesHasAnOpenChain) {
  FakeRigClock clock;
  StopFlag stop(clock);
  InterlockChain chain(clock, nullptr, Lines{}, stop);
  EXPECT_THAT(std::string(Message(chain.Check())), HasSubstr("the rig has no lines"));
}

}  // namespace
}  // namespace mesorig::daemon
