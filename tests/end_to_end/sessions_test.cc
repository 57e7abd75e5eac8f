// What people do with the sessions that they have: list, look, take the frames home, tidy up.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Bytes of the pixels as the camera gave them: 16 bits, little-endian.
std::string PixelsOf(const fs::path& pgm) {
  const std::string bytes = ReadFile(pgm, 1 << 24).value();
  std::istringstream head(bytes);
  std::string magic;
  int width = 0, height = 0, most = 0;
  head >> magic >> width >> height >> most;
  EXPECT_EQ(magic, "P5");
  EXPECT_GT(most, 255);
  const auto start = static_cast<size_t>(head.tellg()) + 1;
  EXPECT_EQ(bytes.size() - start, size_t{2} * width * height);
  std::string pixels = bytes.substr(start);
  for (size_t i = 0; i + 1 < pixels.size(); i += 2) std::swap(pixels[i], pixels[i + 1]);
  return pixels;
}

class SessionsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const nlohmann::json run = rig_.RunPlan();
    id_ = run["session_id"];
    frames_ = run["frames_planned"];
  }
  nlohmann::json Asked(const std::vector<std::string>& words) {
    const Outcome outcome = rig_.Mesorig(words);
    EXPECT_EQ(outcome.code, 0) << outcome.text;
    return nlohmann::json::parse(outcome.text, nullptr, false);
  }
  size_t Sessions() {
    return Asked({"sessions", "--json"}).value("sessions", nlohmann::json::array()).size();
  }

  RunningRig rig_{false};
  std::string id_;
  size_t frames_ = 0;
};

TEST_F(SessionsTest, AreListedAndTellTheirStory) {
  const auto sessions = Asked({"sessions", "--json"})["sessions"];
  ASSERT_EQ(sessions.size(), 1u);
  EXPECT_EQ(sessions[0].value("session_id", ""), id_);
  EXPECT_EQ(sessions[0].value("state", ""), "complete");
  EXPECT_EQ(sessions[0].value("frames_durable", 0u), frames_);
  EXPECT_THAT(rig_.Mesorig({"sessions"}).text, HasSubstr("1 sessions"));
  EXPECT_TRUE(Asked({"session", "verify", id_, "--json"}).value("balances", false));
  const auto entries = Asked({"session", "journal", id_, "--json"})["entries"];
  EXPECT_EQ(std::count_if(entries.begin(), entries.end(),
                          [](const auto& entry) { return entry.value("kind", "") == "ended"; }),
            1);
}

TEST_F(SessionsTest, ExportedFramesAreThoseOfTheLedger) {
  const fs::path out = rig_.folder() / "raw";
  const nlohmann::json figures = Asked({"session", "export", id_, "--out", out.string(), "--json"});
  EXPECT_EQ(figures.value("frames", 0u), frames_);
  std::ifstream ledger(out / "ledger.tsv");
  std::string line;
  std::getline(ledger, line);
  size_t rows = 0;
  for (; std::getline(ledger, line); ++rows) {
    std::vector<std::string> fields;
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, '\t');) fields.push_back(cell);
    ASSERT_EQ(fields.size(), 19u) << line;
    EXPECT_EQ(FrameDigest(PixelsOf(out / fields[18])), fields[15]) << line;
  }
  EXPECT_EQ(rows, frames_);
  const Outcome again = rig_.Mesorig({"session", "export", id_, "--out", out.string()});
  EXPECT_NE(again.code, 0);
  EXPECT_THAT(again.text, HasSubstr("is there already"));
}

TEST_F(SessionsTest, ACompleteOneIsRemovedOnlyWithAWord) {
  const Outcome refused = rig_.Mesorig({"session", "remove", id_});
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.text, HasSubstr("--yes"));
  EXPECT_EQ(rig_.Mesorig({"session", "clean"}).code, 2) << "no rule said";
  EXPECT_EQ(rig_.Mesorig({"session", "clean", "--keep", "1"}).code, 0);
  EXPECT_EQ(Sessions(), 1u);
  EXPECT_EQ(rig_.Mesorig({"session", "clean", "--older-than", "1"}).code, 0);
  EXPECT_EQ(Sessions(), 1u) << "it is younger than a day";
  EXPECT_EQ(rig_.Mesorig({"session", "remove", id_, "--yes"}).code, 0);
  EXPECT_EQ(Sessions(), 0u);
  EXPECT_NE(rig_.Mesorig({"session", "verify", id_}).code, 0);
}

}  // namespace
}  // namespace mesorig::test
