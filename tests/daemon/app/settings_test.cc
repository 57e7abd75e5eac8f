#include "daemon/app/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <random>

#include "daemon/app/check_settings.h"
#include "daemon/app/state_claim.h"
#include "protocol/base/file_writer.h"
#include "tests/fixtures/damaged_text.h"

namespace mesorig::daemon {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr std::string_view kFull = R"(
rig = "rig.toml"
state_dir = "/var/lib/mesorig"
runtime_dir = "/run/mesorig"
[log]
levels = "warn,safety=debug"
format = "json"
[metrics]
port = 9464
[access]
listen = "0.0.0.0:7443"
tls_dir = "tls"
[access.groups]
observer = "lab"
[notify]
on = ["fault", "alarm"]
timeout_s = 2.5
command = ["/usr/bin/mail", "-s", "hush-subject", "lab@example.org"]
webhook = "https://anna:hush-password@hooks.example.org/hush-path?token=hush-token"
headers = ["Authorization: Bearer hush-bearer", "X-Lab: hush-lab"]
)";

Status Parse(std::string_view text, Settings& settings) {
  return ParseSettings(text, "mesorigd.toml", "/etc/mesorig", settings);
}

std::string Refusal(std::string_view text) {
  Settings settings;
  const Status status = Parse(text, settings);
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << text;
  return std::string(Message(status));
}

TEST(Settings, ReadsAll) {
  Settings settings;
  ASSERT_EQ(Parse(kFull, settings), OkStatus());
  EXPECT_EQ(settings.rig, "/etc/mesorig/rig.toml") << "beside the file";
  EXPECT_EQ(settings.state_dir, "/var/lib/mesorig");
  EXPECT_EQ(settings.log.levels, "warn,safety=debug");
  EXPECT_EQ(settings.log.format, LogFormat::kJson);
  EXPECT_EQ(settings.metrics_port, 9464);
  EXPECT_EQ(settings.access.tls_dir, "/etc/mesorig/tls");
  EXPECT_EQ(settings.access.groups.at(Role::kObserver), "lab");
  EXPECT_EQ(settings.notify.limit.count(), 2500);
  EXPECT_THAT(settings.notify.on, ElementsAre("fault", "alarm"));
  EXPECT_EQ(settings.notify.command.size(), 4u);
}

TEST(Settings, TheShippedFileIsRight) {
  Settings settings;
  const Status status = ReadSettings(MESORIG_SOURCE_DIR "/packaging/mesorigd.toml", settings);
  ASSERT_EQ(status, OkStatus());
  EXPECT_EQ(settings.metrics_port, 9464);
}

TEST(Settings, RefusesWithFileLineAndColumn) {
  EXPECT_THAT(Refusal("rig = \"a\"\nrgi = \"b\"\n"), HasSubstr("mesorigd.toml:2:"));
  EXPECT_THAT(Refusal("[metrics]\nport = 70000\n"), HasSubstr("mesorigd.toml:2:"));
  EXPECT_THAT(Refusal("[log]\nlevels = \"safty=debug\"\n"), HasSubstr("\"safty\""));
  EXPECT_THAT(Refusal("[log]\nformat = \"xml\"\n"), HasSubstr("mesorigd.toml:2:"));
  EXPECT_THAT(Refusal("[notify]\nwebhook = \"file:///etc/passwd\"\n"), HasSubstr("notify.webhook"));
  EXPECT_THAT(Refusal("[notify]\non = [\"lunch\"]\n"), HasSubstr("\"lunch\""));
  EXPECT_THAT(Refusal("[notify]\ntimeout_s = 0\n"), HasSubstr("mesorigd.toml:2:"));
  EXPECT_THAT(Refusal("[notify]\nheaders = [\"A: b\\nC: d\"]\n"), HasSubstr("notify.headers"));
}

TEST(Settings, AreUntouchedByAFileThatIsRefused) {
  Settings settings;
  settings.rig = "before";
  EXPECT_FALSE(Parse("rig = \"after\"\nwings = 2\n", settings).ok());
  EXPECT_EQ(settings.rig, "before");
}

TEST(Settings, DamagedFilesAreRefusedOrRead) {
  std::mt19937 random(11);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    Settings settings;
    refused +=
        !Parse(test::Damaged(std::string(kFull), random, 1 + i % 3, "=[]\"\n#.{},"), settings).ok();
  }
  for (size_t i = 0; i < kFull.size(); ++i) {
    Settings settings;
    (void)Parse(kFull.substr(0, i), settings);
  }
  EXPECT_GT(refused, 1000);
}

TEST(Settings, NothingSecretIsPrinted) {
  Settings settings;
  ASSERT_EQ(Parse(kFull, settings), OkStatus());
  const std::string text = SettingsText(settings);
  EXPECT_THAT(text, Not(HasSubstr("hush")));
  EXPECT_THAT(text, HasSubstr("https://hooks.example.org/(left out)"));
  Settings again;
  EXPECT_EQ(Parse(text, again), OkStatus()) << text;
  const std::string log =
      "sent to https://anna:hush-password@hooks.example.org/hush-path?token=hush-token\n"
      "curl: hush-bearer, hush-lab; token hush-token, path /hush-path, mail -s hush-subject\n"
      "-----BEGIN EC PRIVATE KEY-----\nhush\n-----END EC PRIVATE KEY-----\n"
      "-----BEGIN CERTIFICATE-----\npublic\n-----END CERTIFICATE-----\n"
      "-----BEGIN PRIVATE KEY-----\nhush, torn off";
  const std::string clean = WithoutSecrets(log, SecretsOf(settings));
  EXPECT_THAT(clean, Not(HasSubstr("hush"))) << clean;
  EXPECT_THAT(clean, HasSubstr("public"));
}

TEST(Settings, TellWhatNeedsARestart) {
  Settings running;
  ASSERT_EQ(Parse(kFull, running), OkStatus());
  Settings wanted = running;
  wanted.log.levels = "debug";
  wanted.notify.on = {"finish"};
  EXPECT_THAT(NeedRestart(running, wanted), ElementsAre());
  wanted.rig = "/other.toml";
  wanted.metrics_port = std::nullopt;
  EXPECT_THAT(NeedRestart(running, wanted), ElementsAre("rig", "metrics.port"));
}

class CheckTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fmt::format("/tmp/mesorig-check-{}", ::getpid());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    settings_.rig = MESORIG_SOURCE_DIR "/rigs/demo.toml";
    settings_.state_dir = folder_ / "state";
    settings_.runtime_dir = folder_ / "run";
    settings_.metrics_port = 0;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path folder_;
  Settings settings_;
};

TEST_F(CheckTest, SaysYesAndLeavesNothing) {
  EXPECT_EQ(CheckSettings(settings_), OkStatus());
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

TEST_F(CheckTest, SaysAllThatIsWrong) {
  settings_.rig = folder_ / "none.toml";
  settings_.state_dir = folder_ / "file/state";  // (root may write anywhere)
  ASSERT_EQ(WriteFileAtomically(folder_ / "file", ""), OkStatus());
  settings_.runtime_dir = folder_ / std::string(120, 'r');
  settings_.notify.command = {"/nowhere/mail"};
  settings_.notify.webhook = "http://localhost/";
  settings_.notify.curl = "no-such-curl";
  const Status status = CheckSettings(settings_);
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  const std::vector<std::string> parts = {"none.toml", "state_dir " + settings_.state_dir,
                                          "107 bytes", "/nowhere/mail", "no-such-curl"};
  for (const std::string& part : parts) {
    EXPECT_THAT(std::string(Message(status)), HasSubstr(part));
  }
}

TEST_F(CheckTest, ADaemonThatRunsIsNoError) {
  const auto claim = ClaimState(settings_.state_dir);
  ASSERT_TRUE(claim.ok()) << claim.status();
  EXPECT_EQ(CheckSettings(settings_), OkStatus());
  const auto second = ClaimState(settings_.state_dir);
  EXPECT_TRUE(absl::IsFailedPrecondition(second.status()));
  EXPECT_THAT(std::string(Message(second.status())),
              HasSubstr(fmt::format("in use by another mesorigd (process {})", ::getpid())));
}

}  // namespace
}  // namespace mesorig::daemon
