// The systemd units: valid, and as closed as docs/operations.md says.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <regex>

#include "protocol/base/child_process.h"
#include "protocol/base/file_writer.h"

namespace mesorig {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

const fs::path kPackaging = MESORIG_SOURCE_DIR "/packaging";

class Units : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    if (!RunChild({{"systemd-analyze", "--version"}, {}, ""}).ok()) {
      GTEST_SKIP() << "no systemd-analyze here (package systemd)";
    }
  }
  fs::path unit() const { return kPackaging / fmt::format("{}.service", GetParam()); }
};

// "4.2" of "→ Overall exposure level for x.service: 4.2 OK".
std::string Exposure(const fs::path& unit) {
  // (Its table is longer than what a child's output is kept of: the last line is asked for.)
  const auto said = RunChild(
      {{"/bin/sh", "-c", "systemd-analyze security --offline=yes --no-pager \"$1\" | tail -n 1", "sh",
        unit.string()},
       {},
       "",
       std::chrono::seconds(60)});
  if (!said.ok()) return std::string(Message(said.status()));
  std::smatch match;
  return std::regex_search(said->output, match, std::regex("service: ([0-9.]+) ")) ? match[1].str()
                                                                                  : said->output;
}

TEST_P(Units, AreAsClosedAsTheDocumentSays) {
  const std::string exposure = Exposure(unit());
  const std::string document = ReadFile(MESORIG_SOURCE_DIR "/docs/operations.md").value();
  EXPECT_THAT(document, HasSubstr(fmt::format("| {}.service | {} (", GetParam(), exposure)));
  EXPECT_LE(std::stod(exposure), 2.0);
}

TEST_P(Units, AreValid) {
  // The programs are not installed where this is tested.
  const fs::path folder = fs::temp_directory_path() / fmt::format("mesorig-units-{}", ::getpid());
  fs::create_directories(folder);
  for (const auto& entry : fs::directory_iterator(kPackaging)) {
    if (entry.path().extension() != ".service") continue;
    std::string text = ReadFile(entry.path()).value();
    text = std::regex_replace(text, std::regex("/usr/bin/mesorig[a-z-]*"), "/bin/true");
    ASSERT_EQ(WriteFileAtomically(folder / entry.path().filename(), text), OkStatus());
  }
  const auto said = RunChild({{"systemd-analyze", "verify", "--man=no",
                               (folder / unit().filename()).string()},
                              {},
                              "",
                              std::chrono::seconds(60)});
  ASSERT_TRUE(said.ok()) << said.status();
  EXPECT_EQ(said->code, 0) << said->output;
  EXPECT_THAT(said->output, ::testing::Not(HasSubstr(GetParam()))) << "no warning names it";
  fs::remove_all(folder);
}

INSTANTIATE_TEST_SUITE_P(Packaging, Units, ::testing::Values("mesorigd", "mesorig-processd"),
                         [](const auto& unit) {
                           std::string name = unit.param;
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace mesorig
