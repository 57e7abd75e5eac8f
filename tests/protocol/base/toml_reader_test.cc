#include "protocol/base/toml_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace mesorig {
namespace {

// Reads a small file type and returns what Finish says.
Status ReadLamp(std::string_view text) {
  auto file = TomlFile::Parse(text, "f.toml");
  if (!file.ok()) return file.status();
  TomlTable root = file->root();
  root.String("name");
  for (TomlTable lamp : root.Tables("lamp")) {
    lamp.Number("watts", {0, 500});
    lamp.IntegerOr("channel", 0, {0, 7});
    lamp.VectorOr("at", {});
    if (lamp.Has("kind")) lamp.Word("kind", {"halogen", "led"});
  }
  return file->Finish();
}

std::string ErrorOf(std::string_view text) { return std::string(Message(ReadLamp(text))); }

TEST(TomlReader, AcceptsWhatItKnows) {
  EXPECT_TRUE(ReadLamp("name='a'\n[[lamp]]\nwatts=20\nkind='led'\nat=[1,2.5,3]\n").ok());
}

TEST(TomlReader, EveryErrorNamesFileLineColumn) {
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=20\ncolour=3\n"),
            "f.toml:4:1: unknown key `colour`; known here: at, channel, kind, watts");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\n  watts=501\n"),
            "f.toml:3:3: `watts` is 501, permitted is 0 to 500");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=nan\n").substr(0, 10), "f.toml:3:1");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nchannel=1\n"), "f.toml:2:1: `watts` is missing");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=true\n"), "f.toml:3:1: `watts` must be a number");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=1\nat=[1,2]\n"),
            "f.toml:4:1: `at` holds 2 numbers, three are needed");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=1\nkind='gas'\n"),
            "f.toml:4:1: `kind` is \"gas\", permitted is halogen, led");
  EXPECT_EQ(ErrorOf("name='a'\n[lamp]\nwatts=1\n").substr(0, 7), "f.toml:");
  EXPECT_EQ(ErrorOf("name = = 3").substr(0, 9), "f.toml:1:");
}

TEST(TomlReader, ReportsTheErrorThatStandsFirst) {
  EXPECT_EQ(ErrorOf("stray=1\nname='a'\n[[lamp]]\nwatts=-1\n").substr(0, 10), "f.toml:1:1");
  EXPECT_EQ(ErrorOf("name='a'\n[[lamp]]\nwatts=-1\nstray=1\n").substr(0, 10), "f.toml:3:1");
}

TEST(TomlReader, UnreadTablesAreUnknownKeys) {
  EXPECT_EQ(ErrorOf("name='a'\n[extra]\nx=1\n").substr(0, 9), "f.toml:2:");
}

TEST(TomlFile, CharactersOutsideOfAsciiStandInStringsAndCommentsAlone) {
  const auto refusal = [](std::string_view text) {
    return std::string(Message(TomlFile::Parse(text, "a.toml").status()));
  };
  EXPECT_THAT(refusal("a = 1\nb = \u03e0-308\n"), ::testing::StartsWith("a.toml:2:5: a character"));
  EXPECT_THAT(refusal("\u00e4 = 1\n"), ::testing::StartsWith("a.toml:1:1: a character"));
  EXPECT_THAT(refusal("a = \"\"\u00e4\n"), ::testing::StartsWith("a.toml:1:7: a character"));
  EXPECT_THAT(refusal("a = \"\\\"\" \u00e4\n"), ::testing::StartsWith("a.toml:1:10: a character"));
  EXPECT_THAT(refusal("a = '\\' \u00e4\n"), ::testing::StartsWith("a.toml:1:9: a character"));
  for (const char* good :
       {"a = \"\u00e4\" # \u00e4\n", "a = '\u00e4'\n", "\"\u00e4\" = 1\n",
        "a = \"\"\"\u00e4\n\"\u00e4\\\"\"\"\u00e4\"\"\"\n", "a = '''\u00e4\n'''\n# \u00e4",
        "\xef\xbb\xbf"
        "a = 1\n"}) {
    EXPECT_EQ(refusal(good), "") << good;
  }
  EXPECT_NE(refusal("a = \"\u00e4"), "") << "never ends";
  EXPECT_NE(refusal("a = \"\u00e4\\"), "");
}

}  // namespace
}  // namespace mesorig
