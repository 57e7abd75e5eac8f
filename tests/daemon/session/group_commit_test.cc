// The writer thread when the disk is slow, full or broken.

#include <sys/resource.h>
#include <sys/wait.h>

#include <csignal>
#include <cstdio>

#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

// More pixels than may wait: Append blocks and goes on, nothing is lost.
TEST(GroupCommit, BoundsWhatWaitsForTheDisk) {
  TemporaryFolder folder;
  const Rig rig = SmallRig();
  const CompiledPlan plan = SmallPlan(rig, 4);
  const auto session = Session::Create(folder.path(), plan, rig, {.max_queued_bytes = 100});
  ASSERT_TRUE(session.ok());
  ASSERT_TRUE(AppendAll(**session, plan).ok());
  EXPECT_TRUE((*session)->Flush().ok());
  EXPECT_EQ((*session)->Summary().frames_durable, 256u);
  EXPECT_TRUE((*session)->Flush().ok()) << "with nothing to do";
  EXPECT_TRUE((*session)->Finish(true, "", 1, 1, true).ok());
}

// In a child: the file size limit would hit everybody else's files.
std::string RunWithFullDisk(const std::filesystem::path& root, rlim_t limit) {
  const Rig rig = SmallRig();
  const CompiledPlan plan = SmallPlan(rig, 6);
  auto session = Session::Create(root, plan, rig);
  if (!session.ok()) return "create: " + session.status().ToString();
  std::signal(SIGXFSZ, SIG_IGN);  // write then fails with EFBIG
  rlimit size{limit, RLIM_INFINITY};
  ::setrlimit(RLIMIT_FSIZE, &size);
  for (const Step& step : plan.steps) {
    if (step.kind != StepKind::kShot) continue;
    const Status appended = AppendShot(**session, step);
    if (!appended.ok()) return "Append: " + appended.ToString();
  }
  const Status full = (*session)->Flush();
  if (!absl::IsUnavailable(full)) return "Flush: " + full.ToString();
  if (!absl::IsUnavailable((*session)->Storage())) return "Storage forgot the error";
  if (!absl::IsUnavailable((*session)->Finish(true, "", 1, 1, true))) return "Finish forgot it";
  if ((*session)->Summary().end != SessionEnd::kOpen) return "ended";
  size.rlim_cur = RLIM_INFINITY;  // there is room again
  ::setrlimit(RLIMIT_FSIZE, &size);
  const Status finished = (*session)->Finish(true, "", 1, 1, true);
  if (!finished.ok()) return "Finish: " + finished.ToString();
  return "as it should be: " + std::string(Message(full));
}

TEST(GroupCommit, AFullDiskIsReportedAndCostsNothing) {
  TemporaryFolder folder;
  for (const rlim_t limit : {rlim_t{1000}, rlim_t{1500}, rlim_t{4000}}) {
    const auto root = folder.path() / std::to_string(limit);
    int pipe_ends[2];
    ASSERT_EQ(::pipe(pipe_ends), 0);
    const pid_t child = ::fork();
    if (child == 0) {
      const std::string text = RunWithFullDisk(root, limit);
      ::_exit(::write(pipe_ends[1], text.data(), text.size()) < 0 ? 1 : 0);
    }
    ::close(pipe_ends[1]);
    std::string text(4096, '\0');
    const ssize_t n = ::read(pipe_ends[0], text.data(), text.size());
    ::close(pipe_ends[0]);
    text.resize(n < 0 ? 0 : static_cast<size_t>(n));
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(status, 0);
    EXPECT_TRUE(text.starts_with("as it should be")) << text;
    // Either the segment or the journal's WAL was the first to hit the limit; both name file,
    // operation and bytes or rows.
    EXPECT_TRUE(text.find(".seg: writing ") != std::string::npos ||
                text.find("journal.sqlite: ") != std::string::npos)
        << text;
    EXPECT_TRUE(text.ends_with(" bytes wait in memory")) << text;
    const auto ids = ListSessions(root);
    ASSERT_EQ(ids->size(), 1u);
    const auto session = Session::Open(root, ids->front());
    ASSERT_TRUE(session.ok()) << session.status();
    EXPECT_EQ((*session)->Summary().end, SessionEnd::kComplete);
    for (int camera = 0; camera < 8; ++camera) {
      const Replay replay = ReadAll(**session, camera, 48);
      EXPECT_TRUE(replay.bad.empty());
      EXPECT_EQ(replay.good.size(), 48u);
    }
  }
}

}  // namespace
}  // namespace mesorig::daemon
