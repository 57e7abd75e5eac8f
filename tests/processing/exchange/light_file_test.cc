#include "processing/exchange/multi_light/light_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace mesorig::exchange::multi_light {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(NaturalOrder, NumbersCountAsNumbers) {
  std::vector<std::string> names = {"cat.10.tga", "cat.2.tga", "cat.1.tga", "b", "a10", "a9"};
  std::sort(names.begin(), names.end(), NaturalLess);
  EXPECT_THAT(names, ElementsAre("a9", "a10", "b", "cat.1.tga", "cat.2.tga", "cat.10.tga"));
}

TEST(NaturalOrder, IsAStrictWeakOrder) {
  std::mt19937 random(1);
  std::vector<std::string> names;
  for (int i = 0; i < 60; ++i) {
    std::string name;
    for (size_t n = random() % 6; n > 0; --n) name.push_back("0012a."[random() % 6]);
    names.push_back(name);
  }
  for (const auto& a : names) {
    EXPECT_FALSE(NaturalLess(a, a));
    for (const auto& b : names) {
      EXPECT_FALSE(NaturalLess(a, b) && NaturalLess(b, a)) << a << " " << b;
      for (const auto& c : names) {
        if (NaturalLess(a, b) && NaturalLess(b, c)) {
          EXPECT_TRUE(NaturalLess(a, c)) << a << " " << b << " " << c;
        }
      }
    }
  }
}

TEST(LightFile, LpWithSpacesAndWindowsLines) {
  const auto lights = ParseLp("2\r\nmy image 1.jpg 0 0 2\r\n\r\nb.jpg 0.6 0 0.8\r\n", "f");
  ASSERT_TRUE(lights.ok()) << lights.status();
  EXPECT_EQ((*lights)[0].image, "my image 1.jpg");
  EXPECT_EQ((*lights)[0].direction, (Vec3{0, 0, 1}));
  EXPECT_NEAR((*lights)[1].direction.x, 0.6, 1e-12);
}

TEST(LightFile, ErrorsNameFileLineAndField) {
  const auto message = [](const char* text) {
    return std::string(Message(ParseLights(text, "lights.txt").status()));
  };
  EXPECT_THAT(message(""), HasSubstr("lights.txt: is empty"));
  EXPECT_THAT(message("x\n"), HasSubstr("lights.txt:1: count `x`"));
  EXPECT_THAT(message("2\n0 0 1\n"), HasSubstr("announces 2 lights, holds 1"));
  EXPECT_THAT(message("1\n0 y 1\n"), HasSubstr("lights.txt:2: y = `y`"));
  EXPECT_THAT(message("1\n0 0 0\n"), HasSubstr("lights.txt:2: the light vector has no direction"));
  EXPECT_THAT(message("1\n0 nan 1\n"), HasSubstr("is not a number"));
  EXPECT_THAT(message("1\na.png 0 0 1\n"), HasSubstr("expected `x y z`"));
  EXPECT_THAT(std::string(Message(ParseLp("1\n0 0 1\n", "f.lp").status())),
              HasSubstr("expected `image x y z`"));
}

TEST(LightFile, SurvivesAnyBytes) {
  const std::string valid = "3\na.jpg 0 0 1\nb.jpg 0.6 0 0.8\nc d.jpg -0.6 1e-3 0.8\n";
  std::mt19937 random(9);
  constexpr char kNasty[] = "\0\n \t-.e9xnai\xff";
  for (int i = 0; i < 20000; ++i) {
    std::string text = valid;
    for (size_t k = 1 + random() % 4; k > 0; --k) {
      text[random() % text.size()] = kNasty[random() % (sizeof(kNasty) - 1)];
    }
    if (i % 3 == 0) text.resize(random() % text.size());
    for (const auto& lights : {ParseLp(text, "f"), ParseLights(text, "f")}) {
      if (!lights.ok()) continue;
      for (const LightEntry& entry : *lights) EXPECT_NEAR(Norm(entry.direction), 1, 1e-9);
    }
  }
}

}  // namespace
}  // namespace mesorig::exchange::multi_light
