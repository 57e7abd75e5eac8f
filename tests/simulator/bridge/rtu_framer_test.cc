#include "simulator/bridge/rtu_framer.h"

#include <gtest/gtest.h>

#include <random>

namespace mesorig::simulator {
namespace {

using namespace std::string_literals;

// Unit 5, write coils 0..9: the second on.
const std::string kWrite = "\x05\x0F\x00\x00\x00\x0A\x02\x02\x00"s;
const std::string kRead = "\x05\x04\x00\x00\x00\x03"s;

TEST(RtuFramer, ChecksumOfTheSpecification) {
  // Modbus over serial line V1.02, appendix B: 02 07 has 41 12.
  EXPECT_EQ(WithRtuChecksum("\x02\x07"s), "\x02\x07\x41\x12"s);
}

TEST(RtuFramer, RequestsInOnePieceOrMany) {
  RtuFramer framer;
  framer.Feed(WithRtuChecksum(kWrite) + WithRtuChecksum(kRead));
  EXPECT_EQ(framer.Next(), kWrite);
  EXPECT_EQ(framer.Next(), kRead);
  EXPECT_FALSE(framer.Next());
  for (const char byte : WithRtuChecksum(kWrite)) {
    EXPECT_FALSE(framer.Next());
    framer.Feed({&byte, 1});
  }
  EXPECT_EQ(framer.Next(), kWrite);
  EXPECT_TRUE(framer.empty());
  EXPECT_EQ(framer.refused(), 0u);
}

TEST(RtuFramer, HalfARequestEndsWithSilence) {
  RtuFramer framer;
  framer.Feed(WithRtuChecksum(kWrite).substr(0, 6));
  EXPECT_FALSE(framer.Next());
  framer.Silence();
  framer.Feed(WithRtuChecksum(kRead));
  EXPECT_EQ(framer.Next(), kRead);
}

TEST(RtuFramer, UnknownFunctionsAndWrongChecksumsAreRefused) {
  RtuFramer framer;
  framer.Feed(WithRtuChecksum("\x05\x2B\x0E\x01\x00"s));
  EXPECT_FALSE(framer.Next());
  std::string wrong = WithRtuChecksum(kRead);
  wrong.back() = static_cast<char>(wrong.back() ^ 1);
  framer.Feed(wrong);
  EXPECT_FALSE(framer.Next());
  EXPECT_EQ(framer.refused(), 2u);
  EXPECT_TRUE(framer.empty());
}

// Whatever comes, what goes out has had its checksum.
TEST(RtuFramer, SurvivesMutations) {
  std::mt19937 random(20050101);
  RtuFramer framer;
  int passed = 0;
  for (int n = 0; n < 20000; ++n) {
    std::string bytes = WithRtuChecksum(n % 2 == 0 ? kWrite : kRead);
    for (int edits = static_cast<int>(random() % 3); edits > 0; --edits) {
      const size_t at = random() % (bytes.size() + 1);
      switch (random() % 4) {
        case 0: bytes.resize(at); break;
        case 1: bytes.insert(at, bytes.substr(0, random() % 40)); break;
        default: if (at < bytes.size()) bytes[at] = static_cast<char>(random() % 256);
      }
    }
    framer.Feed(bytes);
    while (const auto request = framer.Next()) {
      ++passed;
      ASSERT_NE(bytes.find(WithRtuChecksum(*request)), std::string::npos) << n;
    }
    framer.Silence();
    ASSERT_TRUE(framer.empty());
  }
  EXPECT_GT(passed, 5000);
  EXPECT_GT(framer.refused(), 2000u);
}

}  // namespace
}  // namespace mesorig::simulator
