#include "simulator/world/sample.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "protocol/base/file_writer.h"

namespace mesorig::world {
namespace {

using ::testing::HasSubstr;

constexpr std::string_view kFlat = R"(
name = "plate"
kind = "flat"
extent_mm = 20
grid_mm = 1
h_ref_mm = 2
[flat]
height_mm = 1
[flat.material]
diffuse = [0.5, 0.4, 0.3]
specular = 0.1
roughness = 0.3
)";

std::string With(std::string_view from, std::string_view to) {
  std::string text(kFlat);
  return text.replace(text.find(from), from.size(), to);
}

std::string ErrorOf(const std::string& text) {
  const auto sample = ParseSample(text, "s.toml");
  EXPECT_FALSE(sample.ok());
  EXPECT_EQ(sample.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(sample.status().message());
}

TEST(Sample, Flat) {
  const auto sample = ParseSample(kFlat, "s.toml");
  ASSERT_TRUE(sample.ok()) << sample.status();
  EXPECT_EQ(sample->surface.height_mm(3, 4), 1);
  EXPECT_EQ(sample->surface.material(0, 0).diffuse[1], 0.4);
}

TEST(Sample, RefusesWhatCannotBe) {
  EXPECT_THAT(ErrorOf(With("specular = 0.1", "specular = 0.6")), HasSubstr("s.toml:11:"));
  EXPECT_THAT(ErrorOf(With("h_ref_mm = 2", "h_ref_mm = 1")), HasSubstr("h_ref_mm"));
  EXPECT_THAT(ErrorOf(With("roughness = 0.3", "roughness = 0")), HasSubstr("roughness"));
  EXPECT_THAT(ErrorOf(With("diffuse = [0.5,", "diffuse = [nan,")), HasSubstr("diffuse"));
  EXPECT_THAT(ErrorOf(With("kind = \"flat\"", "kind = \"foam\"")), HasSubstr("foam"));
  EXPECT_THAT(ErrorOf(With("grid_mm = 1", "grid_mm = 0.001")), HasSubstr("grid_mm"));
  EXPECT_THAT(ErrorOf(With("name", "colour = 1\nname")), HasSubstr("s.toml:2:1"));
  EXPECT_EQ(LoadSample("/nowhere.toml").status().code(), absl::StatusCode::kNotFound);
}

TEST(Sample, SurvivesMutations) {
  std::string original =
      ReadFile(std::string(MESORIG_SOURCE_DIR) + "/rigs/samples/weave.toml").value();
  const std::string coarse = "grid_mm = 2.0";
  original.replace(original.find("grid_mm = 0.1"), 13, coarse);
  std::mt19937 random(11);
  int accepted = 0;
  for (int n = 0; n < 3000; ++n) {
    std::string text = n == 0 ? original : original + "\n";
    for (int e = n == 0 ? 3 : static_cast<int>(random() % 3); e < 3; ++e) {
      const size_t at = random() % text.size();
      switch (random() % 4) {
        case 0: text[at] = static_cast<char>(random() % 256); break;
        case 1: text.erase(at, 1 + random() % 12); break;
        case 2: text[at] = "0123456789.-e\"[]="[random() % 17]; break;
        default: text.insert(at, text.substr(random() % text.size(), random() % 30)); break;
      }
      if (text.empty()) text = "x";
    }
    if (text.find("grid_mm = 2.0") == std::string::npos) continue;  // keeps the test short
    const auto sample = ParseSample(text, "mutant.toml");
    if (!sample.ok()) continue;
    ++accepted;
    for (double x : {-10.0, 0.3, 7.0}) {
      ASSERT_TRUE(std::isfinite(sample->surface.height_mm(x, -x / 3)));
      const Material m = sample->surface.material(x, -x / 3);
      ASSERT_LE(*std::max_element(m.diffuse.begin(), m.diffuse.end()) + m.specular, 1 + 1e-12);
    }
  }
  EXPECT_GT(accepted, 10);
}

}  // namespace
}  // namespace mesorig::world
