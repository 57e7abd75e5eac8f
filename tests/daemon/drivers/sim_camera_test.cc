#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::HasSubstr;

// Of the small rig's cameras.
constexpr Region kWhole{0, 0, 16, 8};

class SimCameraTest : public ::testing::Test {
 protected:
  const Rig rig_ = SmallRig();
  SimRig sim_{rig_};
  RigEnd end_{sim_, rig_};
  std::unique_ptr<Camera> a_ = MakeCamera("sim_camera", end_.context, 0).value();
  std::unique_ptr<Camera> b_ = MakeCamera("sim_camera", end_.context, 1).value();
  RigClock::Member member_{*end_.link, "test"};
  RigClock::Activity activity_{*end_.link, Pace::kFree};
};

TEST_F(SimCameraTest, TriggersOfOneInstantExposeTogether) {
  for (Camera* camera : {a_.get(), b_.get()}) {
    ASSERT_EQ(camera->Open(), OkStatus());
    ASSERT_EQ(camera->Configure(0.02, kWhole, 0), OkStatus());
  }
  const RigTime then = end_.link->Now();
  ASSERT_EQ(a_->Trigger(1), OkStatus());
  ASSERT_EQ(b_->Trigger(1), OkStatus());
  const auto a = a_->Await(1, then + seconds(1)).value();
  const auto b = b_->Await(1, then + seconds(1)).value();
  EXPECT_EQ(a.exposure_start, then);
  EXPECT_EQ(b.exposure_start, then);
  EXPECT_EQ(b.exposure_end, then + milliseconds(20));
  EXPECT_EQ(end_.link->Now(), then + milliseconds(50));  // b reads out for 30 ms
  EXPECT_EQ(a.pixels->size(), rig_.cameras[0].frame_bytes());
}

TEST_F(SimCameraTest, FrameOfAnotherTriggerIsDroppedAndCounted) {
  ASSERT_EQ(a_->Open(), OkStatus());
  ASSERT_EQ(a_->Configure(0.02, kWhole, 0), OkStatus());
  ASSERT_EQ(a_->Trigger(1), OkStatus());
  EXPECT_TRUE(absl::IsDeadlineExceeded(
      a_->Await(1, end_.link->Now() + milliseconds(5)).status()));  // too early
  end_.link->SleepFor(milliseconds(100));
  ASSERT_EQ(a_->Trigger(2), OkStatus());
  EXPECT_EQ(a_->Await(2, end_.link->Now() + seconds(1)).value().trigger_id, 2u);
  EXPECT_EQ(a_->dropped_frames(), 1u);
}

TEST_F(SimCameraTest, ReadsOnlyItsRegion) {
  ASSERT_EQ(a_->Open(), OkStatus());
  uint32_t trigger = 0;
  for (const Region& region : {Region{4, 2, 6, 4}, Region{10, 4, 6, 4}, kWhole}) {
    ASSERT_EQ(a_->Configure(0.02, region, 0), OkStatus());
    ASSERT_EQ(a_->Trigger(++trigger), OkStatus());
    const auto frame = a_->Await(trigger, end_.link->Now() + seconds(1)).value();
    EXPECT_EQ(frame.width, region.width);
    EXPECT_EQ(frame.height, region.height);
    EXPECT_EQ(frame.pixels->size(), static_cast<size_t>(region.width * region.height * 2));
  }
  for (const Region& region : {Region{12, 0, 6, 4}, Region{0, 0, 0, 4}, Region{-2, 0, 4, 4}}) {
    EXPECT_TRUE(absl::IsInvalidArgument(a_->Configure(0.02, region, 0)));
  }
}

TEST_F(SimCameraTest, RefusesWhatItCannotDo) {
  EXPECT_TRUE(absl::IsFailedPrecondition(a_->Trigger(1)));
  ASSERT_EQ(a_->Open(), OkStatus());
  const Status status = a_->Configure(2, kWhole, 0);
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_THAT(std::string(Message(status)),
              HasSubstr("camera C0: exposure 2 s is not in [0.001, 1] s"));
  const RigTime deadline = end_.link->Now() + milliseconds(300);
  EXPECT_TRUE(absl::IsDeadlineExceeded(a_->Await(9, deadline).status()));
  EXPECT_EQ(end_.link->Now(), deadline);
}

TEST_F(SimCameraTest, StopEndsTheWait) {
  ASSERT_EQ(a_->Open(), OkStatus());
  ASSERT_EQ(a_->Trigger(1), OkStatus());
  end_.stop.Raise("enough");
  EXPECT_TRUE(absl::IsCancelled(a_->Await(1, end_.link->Now() + seconds(1)).status()));
}

TEST_F(SimCameraTest, CameraThatTheSimulatorLacks) {
  Rig other = rig_;
  other.cameras[0].serial = "9999";
  DriverContext context = end_.context;
  context.rig = &other;
  const Status status = MakeCamera("sim_camera", context, 0).value()->Open();
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_THAT(std::string(Message(status)), HasSubstr("camera:9999"));
}

}  // namespace
}  // namespace mesorig::daemon
