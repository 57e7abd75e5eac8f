// mesorigd as a service: settings, systemd, one owner, metrics, notifications, reload, bundle, end.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>

#include "protocol/base/child_process.h"
#include "protocol/wire/stop_line.h"
#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// systemd's end of $NOTIFY_SOCKET, for programs that are started while it lives.
class FakeSystemd {
 public:
  explicit FakeSystemd(const std::string& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path.data(), path.size());
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
    ::setenv("WATCHDOG_USEC", "4000000", 1);
    ::unsetenv("WATCHDOG_PID");
  }
  ~FakeSystemd() {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::close(fd_);
  }
  // Everything that was said so far.
  const std::string& Heard() {
    char buffer[4096];
    ssize_t n;
    while ((n = ::recv(fd_, buffer, sizeof(buffer), 0)) > 0) {
      heard_.append(buffer, static_cast<size_t>(n));
      heard_ += '\n';
    }
    return heard_;
  }

 private:
  int fd_ = -1;
  std::string heard_;
};

// Looks until it is so, at most a minute.
bool Await(const std::function<bool()>& what) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!what()) {
    if (std::chrono::steady_clock::now() > limit) return false;
    PollPause();
  }
  return true;
}

std::string Shell(const std::string& command) {
  const auto outcome = RunChild({{"/bin/sh", "-c", command}, {}, "", std::chrono::seconds(60)});
  return outcome.ok() ? outcome->output : std::string(Message(outcome.status()));
}

class OperationsTest : public ::testing::Test {
 protected:
  // A settings file beside the rig's folders; `more`: further lines at its end.
  void WriteSettings(const std::string& levels) {
    const std::string text = fmt::format(
        "rig = \"{}tiny_rig.toml\"\nstate_dir = \"state\"\nruntime_dir = \".\"\n"
        "[log]\nlevels = \"{}\"\n[metrics]\nport = 0\n[notify]\n"
        "command = [\"/bin/sh\", \"-c\", \"cat >> '{}' # hush-argument\"]\n"
        "webhook = \"http://127.0.0.1:9/hush-path?token=hush-token\"\n"
        "headers = [\"Authorization: Bearer hush-bearer\"]\ntimeout_s = 5\n",
        kTiny, levels, Told().string());
    ASSERT_EQ(WriteFileAtomically(Settings(), text), OkStatus());
  }
  std::filesystem::path Settings() const { return rig_.folder() / "mesorigd.toml"; }
  std::filesystem::path Told() const { return rig_.folder() / "told.jsonl"; }
  void RestartWithSettings() {
    EXPECT_EQ(rig_.daemon().End(SIGTERM), 0) << rig_.Logs();
    rig_.StartDaemon({"--config", Settings().string()});
  }
  RunningRig rig_{false};
};

TEST_F(OperationsTest, TellsSystemdItsMetricsAndPeople) {
  WriteSettings("info");
  FakeSystemd systemd((rig_.folder() / "notify").string());
  RestartWithSettings();
  ASSERT_TRUE(Await([&] { return systemd.Heard().find("WATCHDOG=1") != std::string::npos; }));
  EXPECT_THAT(systemd.Heard(), HasSubstr("READY=1\nSTATUS=serves rig tiny"));

  EXPECT_EQ(rig_.Mesorig({"status", "--idle"}).code, 0);
  const auto run = rig_.RunPlan();
  EXPECT_TRUE(run.value("complete", false));
  EXPECT_TRUE(Await([&] {
    return ReadFile(Told()).value_or("").find("\"event\":\"finish\"") != std::string::npos;
  })) << rig_.Logs();

  if (::access("/usr/bin/curl", X_OK) == 0) {
    const std::string url = ReadFile(rig_.folder() / "mesorigd-metrics.endpoint").value();
    const std::string metrics =
        Shell("curl -s " + url + " | grep -v '^#' | grep '^mesorig_[sfrd]'");
    EXPECT_THAT(metrics, HasSubstr("mesorig_frames_durable 36"));
    EXPECT_THAT(metrics, HasSubstr("mesorig_rig_connected 1"));
  }
  const Outcome status = rig_.Mesorig({"status"});
  EXPECT_EQ(status.code, 0);
  EXPECT_LE(std::count(status.text.begin(), status.text.end(), '\n'), 24) << status.text;
  EXPECT_THAT(status.text, HasSubstr("36/36 frames durable"));

  ASSERT_EQ(rig_.Mesorig({"arm", kTiny + "tiny_plan.toml"}).code, 0);
  EXPECT_TRUE(Await([&] {
    return systemd.Heard().find("STATUS=armed, session ") != std::string::npos;
  })) << systemd.Heard();
  EXPECT_EQ(rig_.Mesorig({"stop"}).code, 0);

  // What changed is taken up; a file that is wrong changes nothing.
  WriteSettings("warn,program=debug");
  ::kill(rig_.daemon().pid(), SIGHUP);
  EXPECT_TRUE(Await([&] { return rig_.daemon().Log().find("reloaded") != std::string::npos; }));
  WriteSettings("loud");
  ::kill(rig_.daemon().pid(), SIGHUP);
  EXPECT_TRUE(Await([&] { return rig_.daemon().Log().find("not reloaded") != std::string::npos; }));
  EXPECT_EQ(rig_.daemon().End(SIGTERM), 0);
  EXPECT_THAT(systemd.Heard(), HasSubstr("STOPPING=1"));
}

TEST_F(OperationsTest, TheBundleHoldsNoSecret) {
  WriteSettings("info");
  RestartWithSettings();
  EXPECT_EQ(rig_.Mesorig({"stop", "by hand"}).code, 0);
  EXPECT_TRUE(rig_.RunPlan().value("complete", false));
  const auto bundle = rig_.folder() / "help.tar.gz";
  const Outcome made = rig_.Mesorig({"support-bundle", bundle.string()});
  ASSERT_EQ(made.code, 0) << made.text << rig_.Logs();
  EXPECT_EQ(rig_.Mesorig({"support-bundle", bundle.string()}).code, 2) << "it is there already";
  const std::string folder = rig_.folder().path().string();
  const std::string names = Shell(fmt::format("cd {} && tar -xzvf help.tar.gz", folder));
  for (const char* name : {"help/status.json", "help/daemon-log.txt", "help/daemon-mesorigd.toml",
                           "help/daemon-metrics.txt", "help/daemon-rig.toml", "help/sessions.json",
                           "help/journal-", "help/events.txt"}) {
    EXPECT_THAT(names, HasSubstr(name));
  }
  EXPECT_THAT(Shell(fmt::format("grep -rl hush {}/help ; echo end", folder)), "end\n");
  EXPECT_THAT(Shell(fmt::format("grep -c 'by hand' {}/help/daemon-log.txt", folder)),
              Not(HasSubstr("0\n")));
  EXPECT_THAT(Shell(fmt::format("du -s --block-size=1M {}/help", folder)), HasSubstr("1\t"))
      << "no pixels";
}

TEST_F(OperationsTest, StopHasASocketOfItsOwn) {
  ASSERT_EQ(rig_.Mesorig({"arm", kTiny + "tiny_plan.toml"}).code, 0);
  const auto socket = wire::StopSocket(rig_.folder().path());
  EXPECT_EQ(wire::SayStop(socket, "smoke"), OkStatus());
  EXPECT_TRUE(Await([&] { return rig_.Mesorig({"status", "--idle"}).code == 0; })) << rig_.Logs();
  EXPECT_THAT(rig_.daemon().Log(), HasSubstr("smoke"));
  EXPECT_EQ(rig_.daemon().End(SIGTERM), 0);
  const std::string audit = ReadFile(rig_.folder() / "state" / "audit.jsonl").value_or("");
  EXPECT_THAT(audit, HasSubstr("stop socket"));
  EXPECT_TRUE(absl::IsNotFound(wire::SayStop(socket, "late")));
}

TEST_F(OperationsTest, ASecondDaemonIsToldWhoHasTheRig) {
  const std::string pid = fmt::format("(process {})", rig_.daemon().pid());
  const std::string folder = rig_.folder().path().string();
  const Outcome same = RunProgram("mesorigd", {"--rig", kTiny + "tiny_rig.toml", "--state-dir",
                                               folder + "/other", "--runtime-dir", folder});
  EXPECT_EQ(same.code, 1);
  EXPECT_THAT(same.text, HasSubstr(pid));
  const Outcome state =
      RunProgram("mesorigd", {"--rig", kTiny + "tiny_rig.toml", "--state-dir", folder + "/state",
                              "--runtime-dir", folder + "/r2"});
  EXPECT_EQ(state.code, 1);
  EXPECT_THAT(state.text, HasSubstr(pid));
  const Outcome check =
      RunProgram("mesorigd", {"--rig", kTiny + "tiny_rig.toml", "--state-dir", folder + "/state",
                              "--runtime-dir", folder, "--check-config"});
  EXPECT_EQ(check.code, 0) << check.text;
  EXPECT_THAT(check.text, HasSubstr(pid));
  const Outcome wrong = RunProgram("mesorigd", {"--rig", "/nowhere.toml", "--state-dir", folder,
                                                "--runtime-dir", folder, "--check-config"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.text, HasSubstr("/nowhere.toml"));
}

TEST_F(OperationsTest, EndsAtOnceWhenItsRigIsGone) {
  ASSERT_EQ(rig_.Mesorig({"arm", kTiny + "tiny_plan.toml"}).code, 0);
  EXPECT_EQ(rig_.Mesorig({"status", "--idle"}).code, 1) << "no upgrade now";
  ASSERT_EQ(rig_.Mesorig({"start"}).code, 0);
  rig_.sim().End(SIGKILL);
  EXPECT_TRUE(Await(
      [&] { return rig_.daemon().Log().find("the simulator is gone") != std::string::npos; }));
  EXPECT_EQ(rig_.daemon().End(SIGTERM), 1);
  EXPECT_THAT(rig_.daemon().Log(), Not(HasSubstr("the shutdown hangs")));
  EXPECT_THAT(rig_.daemon().Log(), Not(HasSubstr("the plan did not end")));
}

}  // namespace
}  // namespace mesorig::test
