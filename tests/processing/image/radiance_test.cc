#include "processing/image/radiance.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace mesorig::image {
namespace {

Camera TestCamera(int bits) {
  Camera camera;
  camera.name = "cam";
  camera.width = 6, camera.height = 4;
  camera.pattern = BayerPattern::kRggb;
  camera.bits = bits, camera.black_dn = bits == 8 ? 4 : 64;
  camera.full_well_e = 20000, camera.read_noise_e = 8, camera.electrons_per_radiance_s = 40000;
  return camera;
}

// By hand: code 2064 of 12 bits over black 64: 2000 / 4031 * 20000 e = 9923.096 e; by
// 40000 e per radiance and second in 20 ms (800): 12.403870 W m^-2 sr^-1.
TEST(LinearRadiance, TwelveBitsLittleEndianByHand) {
  std::string bytes;
  for (int k = 0; k < 24; ++k) bytes += {static_cast<char>(0x10), 0x08};  // 0x0810 = 2064
  const auto image = LinearRadiance(TestCamera(12), bytes, 0.02);
  ASSERT_TRUE(image.ok()) << image.status();
  EXPECT_NEAR(image->radiance[7], 12.403870, 1e-5);
  EXPECT_TRUE(image->saturated.empty());
}

TEST(LinearRadiance, EightBitsAndBelowBlack) {
  const auto image = LinearRadiance(TestCamera(8), std::string(24, '\x02'), 0.02);
  ASSERT_TRUE(image.ok());
  EXPECT_NEAR(image->radiance[0], -2.0 / 251 * 20000 / 800, 1e-5) << "noise below black stays";
}

TEST(LinearRadiance, FlagsSaturationWithinReadNoise) {
  const Camera camera = TestCamera(12);
  EXPECT_EQ(SaturationMarginDn(camera), 1 + 7);  // 4 * 8 e / (20000 e / 4031) = 6.45
  std::string bytes(48, '\0');
  bytes[10] = static_cast<char>((4095 - 8) & 0xff), bytes[11] = 0x0f;
  bytes[20] = static_cast<char>((4095 - 9) & 0xff), bytes[21] = 0x0f;
  const auto image = LinearRadiance(camera, bytes, 0.02);
  ASSERT_TRUE(image.ok());
  EXPECT_EQ(image->saturated[5], 1);
  EXPECT_EQ(image->saturated[10], 0);
}

TEST(LinearRadiance, RefusesWhatIsNoFrame) {
  const Camera camera = TestCamera(12);
  const std::string bytes(48, '\0');
  for (const double exposure : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity(),
                                1e-300}) {
    EXPECT_TRUE(absl::IsInvalidArgument(LinearRadiance(camera, bytes, exposure).status()));
  }
  EXPECT_TRUE(absl::IsInvalidArgument(LinearRadiance(camera, bytes.substr(1), 0.02).status()));
  EXPECT_THAT(std::string(LinearRadiance(camera, std::string(48, '\x10'), 0.02).status().message()),
              testing::HasSubstr("code value 4112 at column 0, row 0 is above 4095"));
}

TEST(LinearRadiance, RandomBytesNeverGiveNan) {
  std::mt19937 random(3);
  for (int round = 0; round < 2000; ++round) {
    std::string bytes(random() % 8 == 0 ? random() % 60 : 48, '\0');
    for (char& b : bytes) b = static_cast<char>(random() & (random() % 4 == 0 ? 0xff : 0x0f));
    const auto image = LinearRadiance(TestCamera(12), bytes, 0.02);
    if (!image.ok()) continue;
    for (const float value : image->radiance) ASSERT_TRUE(std::isfinite(value));
  }
}

}  // namespace
}  // namespace mesorig::image
