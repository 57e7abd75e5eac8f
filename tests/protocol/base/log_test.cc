#include "protocol/base/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace mesorig {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;

class LogTest : public ::testing::Test {
 protected:
  void SetUp() override { StartLogging("test"); }
  void TearDown() override { EXPECT_EQ(SetLogging({}), OkStatus()); }
  static std::string Last() {
    const auto lines = RecentLog();
    return lines.empty() ? "" : lines.back();
  }
};

TEST_F(LogTest, EachPartHasItsLevel) {
  ASSERT_EQ(SetLogging({"warn,safety=debug", LogFormat::kText}), OkStatus());
  Log("control").info("not heard");
  EXPECT_THAT(Last(), ::testing::Not(HasSubstr("not heard")));
  Log("safety").debug("heard");
  EXPECT_THAT(Last(), ContainsRegex("^20..-..-..T..:..:..\\....Z test safety debug heard\n$"));
  ASSERT_EQ(SetLogging({"safety=off", LogFormat::kText}), OkStatus()) << "changes while it runs";
  Log("safety").critical("gone");
  Log("control").info("here");
  EXPECT_THAT(Last(), HasSubstr("control info here"));
}

TEST_F(LogTest, JsonIsOneObjectALine) {
  ASSERT_EQ(SetLogging({"info", LogFormat::kJson}), OkStatus());
  Log("notify").warn("\"{}\"\n{}", "a", "b\xff");
  const auto json = nlohmann::json::parse(Last(), nullptr, false);
  ASSERT_TRUE(json.is_object()) << Last();
  EXPECT_EQ(json["part"], "notify");
  EXPECT_EQ(json["level"], "warning");
  EXPECT_THAT(std::string(json["message"]), HasSubstr("\"a\"\nb"));
}

TEST_F(LogTest, AMessageCannotForgeALine) {
  Log("service").info("stopped: {}", "a\n2026 mesorigd safety info all is well\x1b[2J");
  const std::string line = Last();
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1);
  EXPECT_THAT(line, HasSubstr("a\\n2026"));
  EXPECT_THAT(line, HasSubstr("\\x1b[2J"));
}

TEST_F(LogTest, RefusesUnknownPartsAndLevels) {
  const Status part = CheckLogging({"safty=debug", LogFormat::kText});
  EXPECT_TRUE(absl::IsInvalidArgument(part));
  EXPECT_THAT(std::string(Message(part)), HasSubstr("\"safty\": the parts are program, access"));
  EXPECT_THAT(std::string(Message(CheckLogging({"safety=loud", LogFormat::kText}))),
              HasSubstr("\"loud\" is none of trace"));
  EXPECT_FALSE(SetLogging({"safety=", LogFormat::kText}).ok());
  Log("safety").info("as before");
  EXPECT_THAT(Last(), HasSubstr("as before"));
}

}  // namespace
}  // namespace mesorig
