// mesorig as a person meets it when things are wrong: one clear line and the right exit code.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "protocol/base/status.h"

namespace {

using ::testing::HasSubstr;

struct Outcome {
  int code = -1;
  std::string text;  // stdout and stderr together
};

Outcome Mesorig(const std::string& arguments) {
  const std::string command = fmt::format("{}/mesorig {} 2>&1", MESORIG_BIN_DIR, arguments);
  FILE* pipe = ::popen(command.c_str(), "r");
  Outcome outcome;
  char buffer[4096];
  while (const size_t n = std::fread(buffer, 1, sizeof(buffer), pipe))
    outcome.text.append(buffer, n);
  const int status = ::pclose(pipe);
  outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return outcome;
}

int Lines(const std::string& text) {
  return static_cast<int>(std::count(text.begin(), text.end(), '\n'));
}

const std::string kSource = MESORIG_SOURCE_DIR;
const std::string kNowhere = "--runtime-dir /tmp/mesorig-nobody-is-here";

TEST(Cli, HelpAndVersion) {
  const Outcome help = Mesorig("--help");
  EXPECT_EQ(help.code, 0);
  EXPECT_THAT(help.text, HasSubstr("status"));
  EXPECT_EQ(Mesorig("--version").text, "mesorig 0.1.0\n");
}

TEST(Cli, UsageErrorsExitWithTwo) {
  EXPECT_EQ(Mesorig("").code, 2);
  EXPECT_EQ(Mesorig("fly").code, 2);
  EXPECT_EQ(Mesorig("status --wings").code, 2);
  EXPECT_EQ(Mesorig("run").code, 2);
}

TEST(Cli, NoDaemon) {
  for (const char* command : {"status", "watch", "stop", "acknowledge", "sessions"}) {
    const Outcome outcome = Mesorig(fmt::format("{} {}", command, kNowhere));
    EXPECT_EQ(outcome.code, 1) << command;
    EXPECT_THAT(outcome.text, HasSubstr("mesorigd is not running")) << command;
    EXPECT_EQ(Lines(outcome.text), 1) << outcome.text;
  }
}

TEST(Cli, MissingPlan) {
  const Outcome outcome = Mesorig("run /nowhere/plan.toml " + kNowhere);
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(outcome.text, "mesorig: /nowhere/plan.toml: no such file\n");
}

TEST(Cli, PlanCheck) {
  const Outcome good = Mesorig(
      fmt::format("plan check {0}/plans/demo.toml --rig {0}/rigs/demo.toml --json", kSource));
  EXPECT_EQ(good.code, 0) << good.text;
  EXPECT_THAT(good.text, HasSubstr("\"frames\":11520"));
  const auto path = std::filesystem::temp_directory_path() / fmt::format("bad-{}.toml", ::getpid());
  std::ofstream(path) << "name = \"x\"\nspeed = 3\n";
  const Outcome bad =
      Mesorig(fmt::format("plan check {} --rig {}/rigs/demo.toml", path.string(), kSource));
  EXPECT_EQ(bad.code, 2);
  EXPECT_THAT(bad.text, HasSubstr(path.string() + ":"));
  EXPECT_EQ(Lines(bad.text), 1) << bad.text;
  std::filesystem::remove(path);
}

// What an operator reads before a night: frames, time beside its bound, disk, and who is asked
// what.
TEST(Cli, PlanCheckTellsTheNight) {
  const Outcome outcome =
      Mesorig(fmt::format("plan check {0}/plans/demo.toml --rig {0}/rigs/demo.toml", kSource));
  EXPECT_EQ(outcome.code, 0);
  for (const char* word :
       {"2304 under lamps, 9216 of laser sweeps", "lower bound", "by exposure",
        "before shot 288: Mount the laser at zenith.", "reference plane at 4.2 mm", "free at ."}) {
    EXPECT_THAT(outcome.text, HasSubstr(word));
  }
}

// 894 GB of frames: more than the disk of a machine that runs tests has.
TEST(Cli, PlanCheckSaysWhatDoesNotFit) {
  const auto free = std::filesystem::space(kSource).available;
  if (free > 894'000'000'000u) GTEST_SKIP() << "the disk has " << free << " bytes";
  const Outcome outcome = Mesorig(fmt::format(
      "plan check {0}/plans/wang2005.toml --rig {0}/rigs/wang2005.toml --state-dir {0}", kSource));
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.text, HasSubstr("DOES NOT FIT"));
  EXPECT_THAT(outcome.text, HasSubstr("mesorig: plan wang2005 does not fit: it needs 894"));
}

}  // namespace
