#include "protocol/wire/stop_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/fixtures/damaged_text.h"

namespace mesorig::wire {
namespace {

std::string Line(std::string_view reason) {
  std::string line = StopLine(reason);
  EXPECT_EQ(line.back(), '\n');
  line.pop_back();
  return line;
}

TEST(StopLine, SaysWhy) {
  EXPECT_EQ(*ReadStopLine(Line("the cat is in the rig")), "the cat is in the rig");
  EXPECT_EQ(*ReadStopLine(Line("")), "");
  EXPECT_EQ(*ReadStopLine("stop "), "");
  EXPECT_EQ(*ReadStopLine(Line("two\nlines\x1b")), "two lines ");
  EXPECT_EQ(ReadStopLine(Line(std::string(10'000, 'x')))->size(), kMaxStopLine - 6);
}

TEST(StopLine, NothingElseIsAStop) {
  for (const char* line : {"", "sto", "stopp", "Stop", " stop", "start", "stop\treason"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ReadStopLine(line).status())) << line;
  }
  EXPECT_FALSE(ReadStopLine("stop " + std::string(kMaxStopLine, 'x')).ok());
}

TEST(StopLine, DamagedLinesAreRefusedOrRead) {
  std::mt19937 random(5);
  int read = 0;
  for (int i = 0; i < 20'000; ++i) {
    const auto reason =
        ReadStopLine(test::Damaged("stop because of this", random, 1 + i % 3, "stop \n\x7f"));
    if (!reason.ok()) continue;
    ++read;
    for (const char c : *reason) ASSERT_GE(static_cast<unsigned char>(c), 0x20u);
  }
  EXPECT_GT(read, 100);
}

TEST(StopLine, WithoutADaemonThereIsNobodyToTell) {
  EXPECT_TRUE(absl::IsNotFound(SayStop("/nowhere/mesorigd.stop.sock", "now")));
}

}  // namespace
}  // namespace mesorig::wire
