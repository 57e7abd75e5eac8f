// Frames of sweeps: kept ones in the main segments, the others in files of their own that go when
// the sweep is released.

#include <sys/wait.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "daemon/session/ledger.h"
#include "daemon/session/released_sweeps.h"
#include "protocol/base/digest.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

using Shots = std::vector<uint32_t>;

Shots Range(uint32_t from, uint32_t to, Shots shots = {}) {
  for (uint32_t shot = from; shot <= to; ++shot) shots.push_back(shot);
  return shots;
}

void Overwrite(const std::filesystem::path& path, std::string_view bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

class SweepFrames : public SessionTest {
 protected:
  std::shared_ptr<Session> CreateEnded() {
    auto session = Create();
    EXPECT_TRUE(AppendAll(*session, plan_).ok());
    const Status finished = session->Finish(true, "", 1, 1, true);
    EXPECT_TRUE(finished.ok()) << finished;
    return session;
  }
  std::shared_ptr<Session> Open() {
    auto session = Session::Open(folder_.path(), id_);
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  // Steps of the plan that sweep.
  const Step& SweepStep(uint32_t sweep) const {
    return plan_.steps[plan_.steps.size() - plan_.sweeps + sweep];
  }
  static constexpr uint64_t kHeader = 8 + 16 + 4 + 16;  // of a segment of camN
  static constexpr uint64_t kRecord = 72 + 48;          // 24 pixels of two bytes
  static constexpr uint64_t kSweep1Bytes = 3 * (kHeader + 5 * kRecord);

};

TEST_F(SweepFrames, KeepWhereTheyStandAndWhatTheLaserDid) {
  CreateEnded();
  EXPECT_EQ(plan_.frames, 64u + 6 + 15 + 32);
  const auto session = Open();
  EXPECT_EQ(session->Summary().end, SessionEnd::kComplete);
  EXPECT_EQ(session->Summary().frames_durable, plan_.frames);
  const Replay replay = ReadAll(*session, 3, 20);
  ASSERT_EQ(replay.good.size(), 20u);
  EXPECT_TRUE(replay.bad.empty());
  for (const FrameRecord& got : replay.good) {
    EXPECT_EQ(got.digest, FrameDigest(*PixelsOf(3, got.shot, got.bytes)));
    if (got.shot < 8) {
      EXPECT_FALSE(got.laser.has_value());
      EXPECT_EQ(got.segment, 0u);
      EXPECT_EQ(got.region_x, 0);
      EXPECT_EQ(got.bytes, 128u);
      continue;
    }
    const uint32_t sweep = got.shot < 11 ? 0 : got.shot < 16 ? 1 : 2;
    const FrameRecord sent =
        SweepFrameOf(SweepStep(sweep), sweep == 2 ? 3 : 1, got.shot - SweepStep(sweep).shot);
    ASSERT_TRUE(got.laser.has_value());
    EXPECT_EQ(got.laser->sweep, sweep);
    EXPECT_EQ(got.laser->index, sent.laser->index);
    EXPECT_EQ(got.laser->mount, static_cast<int>(sweep % 2));
    EXPECT_EQ(got.laser->tilt_rad, sent.laser->tilt_rad);
    EXPECT_EQ(got.laser->on, sent.laser->on);
    EXPECT_EQ(got.segment, sweep == 0 ? 0 : sweep + 1);
    EXPECT_EQ(got.region_x, 2);
    EXPECT_EQ(got.region_y, 4);
    EXPECT_EQ(got.width, 6);
    EXPECT_EQ(got.height, 4);
  }
}

TEST_F(SweepFrames, StandInFilesOfTheirOwnUnlessTheyAreKept) {
  CreateEnded();
  EXPECT_EQ(std::filesystem::file_size(File("cam3.seg")), kHeader + 8 * (72 + 128) + 3 * kRecord);
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(File("sweeps"))) {
    names.insert(entry.path().filename().string());
  }
  EXPECT_EQ(names, (std::set<std::string>{"00001.cam0.seg", "00001.cam3.seg", "00001.cam6.seg",
                                          "00002.cam0.seg", "00002.cam1.seg", "00002.cam2.seg",
                                          "00002.cam3.seg", "00002.cam4.seg", "00002.cam5.seg",
                                          "00002.cam6.seg", "00002.cam7.seg"}));
  EXPECT_EQ(std::filesystem::file_size(File("sweeps/00001.cam6.seg")), kHeader + 5 * kRecord);
}

TEST_F(SweepFrames, ReleaseFreesTheBytesAndKeepsTheRows) {
  const auto session = CreateEnded();
  const auto freed = session->ReleaseSweep(1);
  ASSERT_TRUE(freed.ok()) << freed.status();
  EXPECT_EQ(*freed, kSweep1Bytes);
  EXPECT_EQ(*session->ReleaseSweep(1), 0u) << "again";
  EXPECT_FALSE(std::filesystem::exists(File("sweeps/00001.cam0.seg")));
  EXPECT_TRUE(std::filesystem::exists(File("sweeps/00002.cam0.seg")));
  const auto reopened = Open();
  EXPECT_EQ(*reopened->ReleaseSweep(1), 0u);
  for (Session* const each : {session.get(), reopened.get()}) {
    EXPECT_EQ(each->Summary().frames_durable, plan_.frames);
    EXPECT_EQ(*ShotsOf(*each, 0), Range(16, 19, Range(0, 7)));
    EXPECT_EQ(*ShotsOf(*each, 3), Range(16, 19, Range(0, 10)));
    EXPECT_EQ(*ShotsOf(*each, 7), Range(16, 19, Range(0, 7))) << "had no part in sweep 1";
  }
  const auto ledger = Ledger::Open(File("journal.sqlite"));
  ASSERT_TRUE(ledger.ok());
  int rows = 0;
  ASSERT_TRUE((*ledger)
                  ->ForEach([&](const FrameRecord& r) {
                    rows += r.segment == 2;
                    EXPECT_EQ(r.digest, FrameDigest(*PixelsOf(r.camera, r.shot, r.bytes)));
                    return OkStatus();
                  })
                  .ok());
  EXPECT_EQ(rows, 15);
  EXPECT_EQ(*reopened->ReleaseSweep(2), 8 * (kHeader + 4 * kRecord)) << "of a session that ended";
  EXPECT_EQ(*ShotsOf(*reopened, 3), Range(0, 10));
}

// Who read it before it was resumed goes on with that, and releases beside the writer.
TEST_F(SweepFrames, AReleaseBesideTheWriterLosesNothing) {
  {
    const auto session = Create();
    ASSERT_TRUE(AppendAll(*session, plan_).ok());
    ASSERT_TRUE(session->Finish(false, "stopped", 1, 1, true).ok());
  }
  const auto reader = Open();
  const auto writer = Session::Resume(folder_.path(), id_, rig_);
  ASSERT_TRUE(writer.ok()) << writer.status();
  ASSERT_TRUE(reader->ReleaseSweep(1).ok());
  EXPECT_EQ(*ShotsOf(**writer, 0), Range(16, 19, Range(0, 7)));
  EXPECT_EQ(*(*writer)->DropDamaged(), 0u);
  EXPECT_EQ(*(*writer)->ReleaseSweep(1), 0u);
  const Status again = AppendSweep(**writer, SweepStep(1));
  EXPECT_TRUE(absl::IsFailedPrecondition(again)) << again;
  EXPECT_EQ((*writer)->Finish(true, "", 1, 1, true), OkStatus());
}

TEST_F(SweepFrames, ReleaseIsRefusedWhenThePlanKeepsOrTheFramesAreNotAllThere) {
  const auto session = Create();
  const Step& step = SweepStep(1);
  for (uint32_t index = 0; index < 5; ++index) {
    for (size_t k = 0; k < 3; ++k) {
      if (index == 4 && k == 2) continue;
      ASSERT_TRUE(AppendSweepFrame(*session, SweepFrameOf(step, k, index)).ok());
    }
  }
  ASSERT_TRUE(session->Flush().ok());
  const Status kept = session->ReleaseSweep(0).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(kept)) << kept;
  EXPECT_NE(Message(kept).find("keeps the frames of sweep 0"), std::string::npos);
  const Status early = session->ReleaseSweep(1).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(early)) << early;
  EXPECT_NE(Message(early).find("sweep 1: 4 of 5 frames of camera cam6"), std::string::npos)
      << early;
  EXPECT_TRUE(absl::IsFailedPrecondition(session->ReleaseSweep(2).status()));
  for (const uint32_t unknown : {3u, 0xFFFFFFFEu, 0xFFFFFFFFu}) {
    EXPECT_TRUE(absl::IsNotFound(session->ReleaseSweep(unknown).status()));
  }
  // A shot that was taken twice does not stand for the missing one.
  FrameRecord again = SweepFrameOf(step, 2, 3);
  again.supersedes = 4;
  ASSERT_TRUE(AppendSweepFrame(*session, again).ok());
  ASSERT_TRUE(session->Flush().ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(session->ReleaseSweep(1).status()));
  EXPECT_EQ(ShotsOf(*session, 6)->size(), 5u) << "nothing went";
  ASSERT_TRUE(AppendSweepFrame(*session, SweepFrameOf(step, 2, 4)).ok());
  ASSERT_TRUE(session->Flush().ok());
  EXPECT_EQ(*session->ReleaseSweep(1), kSweep1Bytes + kRecord);
  const Status late = AppendSweepFrame(*session, SweepFrameOf(step, 2, 4));
  EXPECT_TRUE(absl::IsFailedPrecondition(late)) << late;
}

// What a kill between the mark and the removal leaves.
TEST_F(SweepFrames, AMarkWithSegmentsBesideItIsAReleasedSweep) {
  CreateEnded();
  const SessionFolder folder(folder_.path() / id_);
  const auto running = Open();
  ASSERT_TRUE(MarkReleased(folder, id_, 2).ok());
  const auto session = Open();
  EXPECT_EQ(*ShotsOf(*session, 5), Range(0, 7));
  EXPECT_FALSE(std::filesystem::exists(File("sweeps/00002.cam5.seg"))) << "Open goes on";
  EXPECT_EQ(*session->ReleaseSweep(2), 0u);
  EXPECT_EQ(session->Summary().frames_durable, plan_.frames);
  // A segment that could not be removed then, and can later.
  std::filesystem::create_directories(File("sweeps/00002.cam4.seg/in the way"));
  const auto blocked = Open();
  EXPECT_EQ(*ShotsOf(*blocked, 4), Range(0, 7));
  const Status status = blocked->ReleaseSweep(2).status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_NE(Message(status).find("00002.cam4.seg: cannot be removed"), std::string::npos);
  std::filesystem::remove_all(File("sweeps/00002.cam4.seg"));
  Overwrite(File("sweeps/00002.cam4.seg"), "left over");
  EXPECT_EQ(*blocked->ReleaseSweep(2), 9u);
}

// A kill of the real thing: the child dies at once after ReleaseSweep.
TEST_F(SweepFrames, AKillAfterReleaseLosesNothingElse) {
  const pid_t child = ::fork();
  if (child == 0) {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    if (!session.ok() || !AppendSweep(**session, SweepStep(0)).ok()) ::_exit(2);
    if (!AppendSweep(**session, SweepStep(1)).ok() || !(*session)->Flush().ok()) ::_exit(3);
    if (!(*session)->ReleaseSweep(1).ok()) ::_exit(4);
    ::raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status)) << "child failed with " << WEXITSTATUS(status);
  id_ = ListSessions(folder_.path())->front();
  const auto session = Open();
  EXPECT_EQ(session->Summary().end, SessionEnd::kOpen);
  EXPECT_EQ(session->Summary().frames_durable, 21u);
  EXPECT_EQ(*ShotsOf(*session, 3), Range(8, 10));
  EXPECT_TRUE(ShotsOf(*session, 0)->empty());
}

TEST_F(SweepFrames, ASegmentWithoutAMarkIsLost) {
  CreateEnded();
  std::filesystem::remove(File("sweeps/00001.cam3.seg"));
  const auto session = Open();
  const Replay replay = ReadAll(*session, 3, 20);
  EXPECT_EQ(replay.good.size(), 15u);
  ASSERT_EQ(replay.bad.size(), 5u);
  EXPECT_TRUE(absl::IsDataLoss(replay.bad[0].second)) << replay.bad[0].second;
  EXPECT_NE(Message(replay.bad[0].second).find("00001.cam3.seg"), std::string::npos);
  EXPECT_NE(Message(replay.bad[0].second).find("frame 12, shot 11"), std::string::npos);
  const Status status = session->ReleaseSweep(1).status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_TRUE(std::filesystem::exists(File("sweeps/00001.cam0.seg"))) << "the others stay";
}

// Two consumers a camera while sweeps come and are released under them: each sees every frame that
// is kept, in order, those of released sweeps or not, and no error.
TEST_F(SweepFrames, ConsumersGoOnWhileSweepsAreReleased) {
  const auto session = Create();
  std::atomic<int> wrong{0};
  std::vector<std::thread> consumers;
  for (int i = 0; i < 16; ++i) {
    consumers.emplace_back([&, camera = i % 8] {
      uint64_t cursor = 0;
      uint32_t kept = 0;
      const bool followed = FollowToEnd(*session, camera, [&](const StoredFrame& frame) {
        const FrameRecord& r = frame.record;
        if (r.sequence <= cursor || *frame.pixels != *PixelsOf(camera, r.shot, r.bytes)) ++wrong;
        kept += r.segment == 0;
        cursor = r.sequence;
      });
      if (!followed) ++wrong;
      if (kept != (camera == 1 || camera == 3 ? 11u : 8u)) ++wrong;
    });
  }
  std::thread releaser([&] {
    for (const uint32_t sweep : {1u, 2u}) {
      for (;;) {
        const Status status = session->ReleaseSweep(sweep).status();
        if (status.ok()) break;
        if (!absl::IsFailedPrecondition(status)) return void(++wrong);
        std::this_thread::yield();
      }
    }
  });
  ASSERT_TRUE(AppendAll(*session, plan_).ok());
  ASSERT_TRUE(session->Flush().ok());
  releaser.join();
  const Status finished = session->Finish(true, "", 1, 1, true);
  EXPECT_TRUE(finished.ok()) << finished;
  for (auto& consumer : consumers) consumer.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(session->Summary().frames_durable, plan_.frames);
}

// Hostile files.

TEST_F(SweepFrames, ACutSweepSegmentCostsItsFramesOnly) {
  CreateEnded();
  const auto path = File("sweeps/00001.cam6.seg");
  const std::string whole = *ReadFile(path);
  ASSERT_EQ(whole.size(), kHeader + 5 * kRecord);
  for (size_t size = 0; size < whole.size(); ++size) {
    Overwrite(path, std::string_view(whole).substr(0, size));
    const size_t left = size < kHeader ? 0 : (size - kHeader) / kRecord;
    if (size % 7 != 0 && size % kRecord != kHeader) continue;
    const auto session = Open();
    const Replay replay = ReadAll(*session, 6, 17);
    ASSERT_EQ(replay.good.size(), 12 + left) << size;
    ASSERT_EQ(replay.bad.size(), 5 - left) << size;
    for (const auto& [sequence, status] : replay.bad) ASSERT_TRUE(absl::IsDataLoss(status));
    ASSERT_TRUE(absl::IsDataLoss(session->ReleaseSweep(1).status())) << size;
  }
}

TEST_F(SweepFrames, AFlippedByteOfASweepSegmentIsNeverHandedOut) {
  CreateEnded();
  const auto path = File("sweeps/00001.cam6.seg");
  const std::string whole = *ReadFile(path);
  std::mt19937 random(11);
  const auto session = Open();
  for (size_t at = 0; at < whole.size(); ++at) {
    std::string bytes = whole;
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
    Overwrite(path, bytes);
    const Replay replay = ReadAll(*session, 6, 17);
    ASSERT_EQ(replay.bad.size(), at < kHeader ? 0u : 1u) << at;
    ASSERT_EQ(replay.good.size(), 17 - replay.bad.size()) << at;
  }
}

TEST_F(SweepFrames, AMarkThatIsNotOursReleasesNothing) {
  CreateEnded();
  const SessionFolder folder(folder_.path() / id_);
  const auto mark = File("sweeps/00001.released");
  ASSERT_TRUE(MarkReleased(folder, id_, 1).ok());
  const std::string whole = *ReadFile(mark);
  std::filesystem::remove(mark);
  std::mt19937 random(12);
  for (int i = 0; i < 3000; ++i) {
    std::string bytes = whole;
    if (i % 3 == 0) {
      bytes.resize(random() % bytes.size());
    } else if (i % 3 == 1) {
      bytes[random() % bytes.size()] ^= static_cast<char>(1 + random() % 255);
    } else {
      bytes += static_cast<char>(random());
    }
    Overwrite(mark, bytes);
    ASSERT_TRUE(FindReleased(folder, id_).empty()) << bytes;
    if (i % 100 == 0) {
      ASSERT_EQ(ShotsOf(*Open(), 6)->size(), 17u);
    }
  }
  Overwrite(mark, whole);
  EXPECT_EQ(FindReleased(folder, id_), std::set<uint32_t>{1});
  EXPECT_TRUE(FindReleased(folder, "another session").empty());
  std::filesystem::remove(mark);
  for (const char* name :
       {"1.released", "000001.released", "00002.released", "x.released", "-0001.released",
        "4294967295.released", "00001.released~", ".released", "99999999999.released"}) {
    Overwrite(File("sweeps") / name, whole);
  }
  std::filesystem::create_directory(mark);
  EXPECT_TRUE(FindReleased(folder, id_).empty());
  EXPECT_EQ(ShotsOf(*Open(), 6)->size(), 17u);
}

// The mark was damaged after its sweep had gone: lost frames, not released ones.
TEST_F(SweepFrames, ADamagedMarkOfAReleasedSweepIsSaid) {
  ASSERT_TRUE(CreateEnded()->ReleaseSweep(1).ok());
  Overwrite(File("sweeps/00001.released"), "garbage");
  const auto session = Open();
  const Status status = ShotsOf(*session, 6).status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_NE(Message(status).find("00001.released does not say"), std::string::npos) << status;
  EXPECT_TRUE(absl::IsDataLoss(session->ReleaseSweep(1).status()));
  // A damaged mark beside whole segments is written anew.
  Overwrite(File("sweeps/00002.released"), "garbage");
  EXPECT_TRUE(session->ReleaseSweep(2).ok());
  EXPECT_EQ(FindReleased(SessionFolder(folder_.path() / id_), id_), std::set<uint32_t>{2});
}

TEST_F(SweepFrames, AMarkOfASweepThatIsKeptChangesNothing) {
  CreateEnded();
  const SessionFolder folder(folder_.path() / id_);
  ASSERT_TRUE(MarkReleased(folder, id_, 0).ok());
  ASSERT_TRUE(MarkReleased(folder, id_, 77).ok());
  EXPECT_EQ(*ShotsOf(*Open(), 3), Range(0, 19));
}

TEST_F(SweepFrames, MutatedJournalsNeverCrashAndNeverLie) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a thousand files that one thread reads: ThreadSanitizer has nothing to see there";
#endif
  CreateEnded();
  const std::string whole = *ReadFile(File("journal.sqlite"));
  std::mt19937 random(13);
  for (int i = 0; i < 1000; ++i) {
    std::string bytes = whole;
    for (unsigned n = 1 + random() % 8; n > 0; --n) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    Overwrite(File("journal.sqlite"), bytes);
    const auto session = Session::Open(folder_.path(), id_);
    if (!session.ok()) continue;
    for (uint64_t cursor = 0; cursor < 21; ++cursor) {
      const auto frame = (*session)->Next(3, cursor, 0);
      if (!frame.ok() || !frame->has_value()) continue;
      const FrameRecord& r = (*frame)->record;
      ASSERT_EQ(*(*frame)->pixels, *PixelsOf(3, r.shot, r.bytes));
    }
  }
}

TEST_F(SweepFrames, FramesAndPlansThatCannotBeAreRefused) {
  const auto session = Create();
  FrameRecord frame = SweepFrameOf(SweepStep(1), 0, 0);
  frame.laser->tilt_rad = std::nan("");
  EXPECT_TRUE(absl::IsInvalidArgument(AppendSweepFrame(*session, frame)));
  frame = SweepFrameOf(SweepStep(1), 0, 0);
  frame.region_y = -2;
  EXPECT_TRUE(absl::IsInvalidArgument(AppendSweepFrame(*session, frame)));
  const auto refused = [&](const std::function<void(Step&)>& change) {
    CompiledPlan plan = plan_;
    change(plan.steps.back());
    return absl::IsInvalidArgument(Session::Create(folder_.path(), plan, rig_).status());
  };
  EXPECT_TRUE(refused([](Step& s) { s.sweep.frames = 5; })) << "beyond the plan's shots";
  EXPECT_TRUE(refused([](Step& s) { s.sweep.frames = 0; }));
  EXPECT_TRUE(refused([](Step& s) { s.sweep.frames = 0xFFFFFFFF; })) << "the sum wraps";
  EXPECT_TRUE(refused([](Step& s) { s.sweep.index = 1; })) << "twice";
  EXPECT_TRUE(refused([](Step& s) { s.sweep.index = 3; }));
  EXPECT_TRUE(refused([](Step& s) { s.sweep.regions.pop_back(); }));
  EXPECT_TRUE(refused([](Step& s) { s.cameras.back() = 8; }));
}

}  // namespace
}  // namespace mesorig::daemon
