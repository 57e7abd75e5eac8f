#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "processing/exchange/importer.h"
#include "processing/image/image_file.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::exchange {
namespace {

using ::testing::HasSubstr;

// An uncompressed TGA of one grey.
std::string Tga(int width, int height, int grey) {
  std::string bytes(18, '\0');
  bytes[2] = 2;
  bytes[12] = static_cast<char>(width);
  bytes[14] = static_cast<char>(height);
  bytes[16] = 24;
  bytes.append(static_cast<size_t>(3 * width * height), static_cast<char>(grey));
  return bytes;
}

class MultiLight : public ::testing::Test {
 protected:
  void Write(const std::string& name, const std::string& bytes) {
    ASSERT_TRUE(WriteFileAtomically(folder_ / name, bytes).ok());
  }
  void WriteStack() {
    Write("p.10.tga", Tga(4, 3, 100));
    Write("p.2.tga", Tga(4, 3, 51));
    Write("lights.txt", "2\n0 0 1\n0.6 0 0.8\n");
  }
  StatusOr<btf::SampledBtf> Import() {
    return (*FindImporter("multi-light"))->Import(folder_.path());
  }
  std::string Error() { return std::string(Message(Import().status())); }
  btf::TemporaryFolder folder_;
};

TEST_F(MultiLight, ReadsInNumericOrder) {
  WriteStack();
  const auto btf = Import();
  ASSERT_TRUE(btf.ok()) << btf.status();
  EXPECT_EQ(btf->header().view_count(), 1);
  EXPECT_EQ(btf->header().light_count(), 2);
  EXPECT_FALSE(btf->header().calibrated);
  EXPECT_TRUE(btf->header().cosine_included);
  EXPECT_TRUE(btf->header().mask.empty());
  EXPECT_FLOAT_EQ(btf->Image(0, 0)[0], 0.2f);
  EXPECT_FLOAT_EQ(btf->Image(0, 1)[0], 100.0f / 255);
}

TEST_F(MultiLight, LightsInTheParentFolderAndAMask) {
  Write("lights.txt", "1\n0 0 1\n");
  std::filesystem::create_directory(folder_ / "stack");
  Write("stack/p.0.tga", Tga(4, 3, 100));
  Write("stack/p.mask.tga", Tga(4, 3, 129));
  const auto btf = (*FindImporter("multi-light"))->Import(folder_.path() / "stack/");
  ASSERT_TRUE(btf.ok()) << btf.status();
  EXPECT_EQ(btf->header().mask, std::vector<uint8_t>(12, 1));
}

TEST_F(MultiLight, LpNamesItsPhotographs) {
  WriteStack();
  Write("s.lp", "2\nC:\\photos\\p.10.tga 0 0 1\nelse/where/p.2.tga 0.6 0 0.8\n");
  const auto btf = Import();
  ASSERT_TRUE(btf.ok()) << btf.status();
  EXPECT_FLOAT_EQ(btf->Image(0, 0)[0], 100.0f / 255);
}

TEST_F(MultiLight, ErrorsSayWhatIsWrong) {
  EXPECT_THAT(Error(), HasSubstr("lights.txt"));
  WriteStack();
  Write("lights.txt", "3\n0 0 1\n0.6 0 0.8\n0 0.6 0.8\n");
  EXPECT_THAT(Error(), HasSubstr("2 photographs, 3 lights"));
  Write("lights.txt", "2\n0 0 1\n0 0 0\n");
  EXPECT_THAT(Error(), HasSubstr("no direction"));
  Write("lights.txt", "2\n0 0 1\n0 0 1\n");
  EXPECT_THAT(Error(), HasSubstr("same direction"));
  Write("lights.txt", "2\n0 0 1\n0.6 0 0.8\n");
  Write("p.10.tga", Tga(5, 3, 1));
  EXPECT_THAT(Error(), HasSubstr("p.10.tga: 5 x 3 pixels"));
  Write("p.10.tga", "no picture");
  EXPECT_THAT(Error(), HasSubstr("p.10.tga: is not a TGA, PNG or JPEG image"));
}

TEST(MultiLightImage, SurvivesDamagedBytes) {
  const std::string valid = Tga(5, 4, 90);
  std::mt19937 random(12);
  for (int i = 0; i < 5000; ++i) {
    std::string bytes = valid;
    for (size_t k = 1 + random() % 3; k > 0; --k) {
      bytes[random() % 24] = static_cast<char>(random() % 2 != 0 ? random() : random() % 33);
    }
    if (i % 4 == 0) bytes.resize(random() % bytes.size());
    const auto image = image::DecodeImage8(bytes, "f");
    if (image.ok()) {
      EXPECT_EQ(image->rgb.size(),
                3 * static_cast<size_t>(image->width) * static_cast<size_t>(image->height));
    }
  }
}

TEST(MultiLightReal, CatHasTwelveLightsAndAMask) {
  const auto folder = std::filesystem::path(MESORIG_SOURCE_DIR).parent_path() /
                      "shared/data/multi_light/cat";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto btf = (*FindImporter("multi-light"))->Import(folder);
  ASSERT_TRUE(btf.ok()) << btf.status();
  EXPECT_EQ(btf->header().width, 512);
  EXPECT_EQ(btf->header().light_count(), 12);
  EXPECT_EQ(std::count(btf->header().mask.begin(), btf->header().mask.end(), 1), 36526);
}

}  // namespace
}  // namespace mesorig::exchange
