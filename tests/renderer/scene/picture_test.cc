#include "renderer/scene/picture.h"

#include <gtest/gtest.h>

#include "protocol/base/file_writer.h"

namespace mesorig::renderer {
namespace {

TEST(PictureTest, WritesAPngOfItsSize) {
  const std::filesystem::path path = testing::TempDir() + "/picture_test.png";
  const Picture picture{3, 2, std::vector<uint8_t>(18, 200)};
  ASSERT_TRUE(WritePng(picture, path).ok());
  const auto bytes = ReadFile(path);
  ASSERT_TRUE(bytes.ok());
  EXPECT_EQ(bytes->substr(1, 3), "PNG");
  EXPECT_EQ((*bytes)[19], 3);  // IHDR: width, height, big endian
  EXPECT_EQ((*bytes)[23], 2);
  std::filesystem::remove(path);
}

TEST(PictureTest, RefusesWhatItCannotWrite) {
  const Picture picture{1, 1, {0, 0, 0}};
  EXPECT_EQ(WritePng(picture, "/nowhere/at/all/x.png").code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(WritePng(picture, testing::TempDir() + "/x.jpg").code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace mesorig::renderer
