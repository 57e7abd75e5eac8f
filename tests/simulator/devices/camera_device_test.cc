#include "simulator/devices/camera/camera_device.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/fixtures/small_rig.h"

namespace mesorig::simulator {
namespace {

using fixtures::SmallRig;
using sim_wire::CameraAccess;
using sim_wire::CameraRegister;
using std::chrono::milliseconds;

// Uniform light: 5000 electrons for 20 ms.
class FlatSource final : public ImageSource {
 public:
  Scene Observe(RigTime from, RigTime to) override {
    observed_from = from;
    observed_to = to;
    Scene scene;
    scene.key.seed = 4;
    return scene;
  }
  StatusOr<std::vector<float>> ExpectedElectrons(int, const Scene& scene,
                                                 double exposure_s) override {
    return std::vector<float>(static_cast<size_t>(scene.region.width * scene.region.height),
                              static_cast<float>(exposure_s * 250000));
  }
  RigTime observed_from{}, observed_to{};
};

class CameraDeviceTest : public ::testing::Test {
 protected:
  CameraDeviceTest() : rig_(SmallRig()), camera_(rig_, 0, source_) {}
  StatusOr<std::string> Write(CameraRegister reg, double value) {
    return camera_.Query({}, sim_wire::Pack(CameraAccess{reg, true, value}), out_);
  }
  sim_wire::CameraFrame Shoot(RigTime at, uint32_t id) {
    camera_.Command(at, sim_wire::Pack(sim_wire::CameraTrigger{id}), out_);
    while (camera_.NextEvent() != kNever) camera_.RunEvent(camera_.NextEvent(), out_);
    const auto said = out_.Take();
    EXPECT_EQ(said.size(), 1u);
    return sim_wire::UnpackCameraFrame(said.at(0)).value();
  }
  Rig rig_;
  FlatSource source_;
  sim_wire::Outbox out_;
  CameraDevice camera_;
};

TEST_F(CameraDeviceTest, DeliversAfterExposureAndReadout) {
  ASSERT_TRUE(Write(CameraRegister::kExposureS, 0.02).ok());
  camera_.Command(milliseconds(100), sim_wire::Pack(sim_wire::CameraTrigger{8}), out_);
  EXPECT_EQ(camera_.NextEvent(), RigTime(milliseconds(120)));
  camera_.RunEvent(milliseconds(120), out_);
  EXPECT_EQ(source_.observed_from, RigTime(milliseconds(100)));
  EXPECT_EQ(source_.observed_to, RigTime(milliseconds(120)));
  EXPECT_TRUE(out_.Take().empty());
  EXPECT_EQ(camera_.NextEvent(), RigTime(milliseconds(130)));
  camera_.RunEvent(milliseconds(130), out_);
  const auto frame = sim_wire::UnpackCameraFrame(out_.Take().at(0)).value();
  EXPECT_EQ(frame.trigger_id, 8u);
  EXPECT_EQ(frame.frame_id, 1u);
  EXPECT_EQ(frame.bits, 12);
}

TEST_F(CameraDeviceTest, SameKeySameBytesAndRepeatsDiffer) {
  ASSERT_TRUE(Write(CameraRegister::kExposureS, 0.02).ok());
  const auto a = Shoot(milliseconds(100), 1), b = Shoot(milliseconds(300), 2);
  EXPECT_EQ(a.pixels, b.pixels) << "time is not part of the key";
  ASSERT_TRUE(Write(CameraRegister::kRepeatIndex, 1).ok());
  EXPECT_NE(Shoot(milliseconds(500), 3).pixels, a.pixels);
}

TEST_F(CameraDeviceTest, ReadsItsRegion) {
  ASSERT_TRUE(Write(CameraRegister::kExposureS, 0.02).ok());
  const auto whole = Shoot(milliseconds(100), 1);
  EXPECT_EQ(whole.width, 16);
  EXPECT_EQ(whole.height, 8);
  ASSERT_TRUE(Write(CameraRegister::kRegionWidth, 6).ok());
  ASSERT_TRUE(Write(CameraRegister::kRegionHeight, 4).ok());
  ASSERT_TRUE(Write(CameraRegister::kRegionX, 10).ok());
  ASSERT_TRUE(Write(CameraRegister::kRegionY, 2).ok());
  camera_.Command(milliseconds(200), sim_wire::Pack(sim_wire::CameraTrigger{2}), out_);
  camera_.RunEvent(camera_.NextEvent(), out_);
  EXPECT_EQ(camera_.NextEvent(), RigTime(milliseconds(225))) << "half the rows, half the readout";
  camera_.RunEvent(camera_.NextEvent(), out_);
  const auto part = sim_wire::UnpackCameraFrame(out_.Take().at(0)).value();
  EXPECT_EQ(part.width, 6);
  EXPECT_EQ(part.height, 4);
  std::string crop;
  for (size_t j = 2; j < 6; ++j) crop += whole.pixels.substr(2 * (16 * j + 10), 12);
  EXPECT_EQ(part.pixels, crop);
}

TEST_F(CameraDeviceTest, RefusesRegionsThatItHasNot) {
  for (double bad : {-2.0, 0.0, 3.0, 4.5, 18.0, 1e300, std::nan("")}) {
    EXPECT_FALSE(Write(CameraRegister::kRegionWidth, bad).ok()) << bad;
  }
  EXPECT_FALSE(Write(CameraRegister::kRegionX, 2).ok()) << "the width reaches the border";
  ASSERT_TRUE(Write(CameraRegister::kRegionHeight, 2).ok());
  ASSERT_TRUE(Write(CameraRegister::kRegionY, 6).ok());
  EXPECT_FALSE(Write(CameraRegister::kRegionHeight, 4).ok());
  EXPECT_FALSE(Write(CameraRegister::kRegionY, 5).ok());
  const auto height = camera_.Query(
      {}, sim_wire::Pack(CameraAccess{CameraRegister::kRegionHeight, false, 0}), out_);
  EXPECT_EQ(sim_wire::UnpackRegisterValue(height.value()).value(), 2);
}

TEST_F(CameraDeviceTest, RefusesWhatItCannotDo) {
  EXPECT_FALSE(Write(CameraRegister::kExposureS, 5).ok());
  EXPECT_FALSE(Write(CameraRegister::kGain, -1).ok());
  EXPECT_FALSE(Write(CameraRegister::kRepeatIndex, 1e30).ok());
  EXPECT_FALSE(camera_.Query({}, "junk", out_).ok());
  camera_.Command({}, sim_wire::Pack(sim_wire::CameraTrigger{1}), out_);
  EXPECT_FALSE(Write(CameraRegister::kGain, 2).ok()) << "busy";
  camera_.Command(milliseconds(1), sim_wire::Pack(sim_wire::CameraTrigger{2}), out_);
  while (camera_.NextEvent() != kNever) camera_.RunEvent(camera_.NextEvent(), out_);
  EXPECT_EQ(out_.Take().size(), 1u) << "the second trigger was ignored";
}

}  // namespace
}  // namespace mesorig::simulator
