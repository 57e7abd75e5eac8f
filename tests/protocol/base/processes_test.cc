// Claims, children and figures of processes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "protocol/base/child_process.h"
#include "protocol/base/claim.h"
#include "protocol/base/process_figures.h"

namespace mesorig {
namespace {

using ::testing::HasSubstr;

TEST(Claim, NamesTheProcessThatHasIt) {
  const std::string file = fmt::format("/tmp/mesorig-claim-{}", ::getpid());
  {
    const auto claim = FileClaim::Take(file, "the rig is taken");
    ASSERT_TRUE(claim.ok()) << claim.status();
    const auto second = FileClaim::Take(file, "the rig is taken");
    EXPECT_TRUE(absl::IsFailedPrecondition(second.status()));
    EXPECT_EQ(Message(second.status()), fmt::format("the rig is taken (process {})", ::getpid()));
  }
  // One that was killed holds nothing.
  const pid_t pid = ::fork();
  if (pid == 0) {
    const auto claim = FileClaim::Take(file, "taken");
    ::kill(::getpid(), SIGKILL);
  }
  ::waitpid(pid, nullptr, 0);
  EXPECT_TRUE(FileClaim::Take(file, "taken").ok());
  EXPECT_TRUE(absl::IsInvalidArgument(FileClaim::Take("/nowhere/lock", "taken").status()));
  ::unlink(file.c_str());
}

TEST(ChildProcess, HandsEverythingOverAsItIs) {
  const auto outcome = RunChild({{"/bin/sh", "-c", "cat; printf '%s|%s' \"$1\" \"$MESORIG_A\"; exit 3",
                                  "sh", "$(id); `id` \"'"},
                                 {"MESORIG_A=a b;c"},
                                 "in\n"});
  ASSERT_TRUE(outcome.ok()) << outcome.status();
  EXPECT_EQ(outcome->code, 3);
  EXPECT_EQ(outcome->output, "in\n$(id); `id` \"'|a b;c");
}

TEST(ChildProcess, InheritsNoDescriptor) {
  int fds[2];
  ASSERT_EQ(::pipe(fds), 0);
  const auto outcome = RunChild({{"/bin/ls", "/proc/self/fd"}, {}, ""});
  ASSERT_TRUE(outcome.ok()) << outcome.status();
  EXPECT_EQ(outcome->output, "0\n1\n2\n3\n") << "3 is the folder that ls reads";
  ::close(fds[0]);
  ::close(fds[1]);
}

TEST(ChildProcess, OneThatHangsIsEndedWithWhatItStarted) {
  const std::string input(1 << 20, 'x');  // which it never reads
  const auto outcome = RunChild({{"/bin/sh", "-c", "sleep 1000 & sleep 1000"},
                                 {},
                                 input,
                                 std::chrono::milliseconds(100)});
  EXPECT_TRUE(absl::IsDeadlineExceeded(outcome.status())) << outcome.status();
  const std::atomic<bool> cancel{true};
  EXPECT_TRUE(absl::IsCancelled(RunChild({{"/bin/sleep", "1000"}, {}, ""}, &cancel).status()));
}

TEST(ChildProcess, SaysWhatCannotBeStarted) {
  const auto missing = RunChild({{"/nowhere/notify"}, {}, ""});
  EXPECT_TRUE(absl::IsNotFound(missing.status()));
  EXPECT_THAT(std::string(Message(missing.status())), HasSubstr("/nowhere/notify"));
  EXPECT_FALSE(RunChild({{}, {}, ""}).ok());
  EXPECT_FALSE(RunChild({{"/etc/passwd"}, {}, ""}).ok());
}

TEST(ProcessFigures, CountWhatIsThere) {
  const ProcessFigures before = ReadProcessFigures();
  EXPECT_GT(before.resident_bytes, 1u << 20);
  EXPECT_GT(before.started_s, 1.6e9);
  int fds[2];
  ASSERT_EQ(::pipe(fds), 0);
  ProcessFigures during;
  std::thread([&] { during = ReadProcessFigures(); }).join();
  EXPECT_EQ(during.open_files, before.open_files + 2);
  EXPECT_EQ(during.threads, before.threads + 1);
  EXPECT_GE(during.cpu_s, before.cpu_s);
  ::close(fds[0]);
  ::close(fds[1]);
}

}  // namespace
}  // namespace mesorig
