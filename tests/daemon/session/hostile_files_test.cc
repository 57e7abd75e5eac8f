// Session files that are cut, flipped or not ours at all: nothing crashes, nothing that is damaged
// is handed out, and what is whole stays readable.

#include <fstream>
#include <functional>
#include <set>

#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

void Overwrite(const std::filesystem::path& path, std::string_view bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

// An ended session of 8 frames a camera, and its bytes to start from each time.
class HostileFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    auto session = Session::Create(folder_.path(), plan_, rig_);
    ASSERT_TRUE(session.ok()) << session.status();
    ASSERT_TRUE(AppendAll(**session, plan_).ok());
    ASSERT_TRUE((*session)->Finish(true, "", 1, 1, true).ok());
    id_ = (*session)->id();
    segment_ = folder_.path() / id_ / "cam3.seg";
    whole_ = *ReadFile(segment_);
  }
  std::filesystem::path File(std::string_view name) const { return folder_.path() / id_ / name; }
  std::shared_ptr<Session> Open() {
    auto session = Session::Open(folder_.path(), id_);
    EXPECT_TRUE(session.ok()) << session.status();
    return *session;
  }
  static constexpr size_t kRecord = 72 + 128;
  size_t FirstRecord() const { return whole_.size() - 8 * kRecord; }

  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SmallPlan(rig_);
  std::string id_, whole_;
  std::filesystem::path segment_;
};

TEST_F(HostileFiles, ACutSegmentCostsTheFramesBeyondTheCut) {
  const auto opened = Open();
  for (size_t size = 0; size < whole_.size(); ++size) {
    Overwrite(segment_, std::string_view(whole_).substr(0, size));
    const size_t expected = size < FirstRecord() ? 0 : (size - FirstRecord()) / kRecord;
    // Opened before the cut, or (slower) after it.
    const Replay replay = ReadAll(size % 50 == 0 ? *Open() : *opened, 3, 8);
    ASSERT_EQ(replay.good.size(), expected) << size;
    ASSERT_EQ(replay.bad.size(), 8 - expected) << size;
    for (const auto& [sequence, status] : replay.bad) {
      ASSERT_TRUE(absl::IsDataLoss(status)) << status;
    }
  }
  EXPECT_EQ(ReadAll(*Open(), 2, 8).good.size(), 8u) << "the other cameras lose nothing";
}

TEST_F(HostileFiles, ATornTailBeyondTheLedgerIsIgnored) {
  const std::string record = whole_.substr(FirstRecord(), kRecord);
  for (size_t torn = 1; torn <= kRecord; ++torn) {
    Overwrite(segment_, whole_ + record.substr(0, torn));
    const Replay replay = ReadAll(*Open(), 3, 20);
    ASSERT_EQ(replay.good.size(), 8u);
    ASSERT_TRUE(replay.bad.empty());
  }
}

TEST_F(HostileFiles, AFlippedByteCostsItsFrameOnlyAndNamesIt) {
  std::mt19937 random(1);
  const auto opened = Open();
  for (size_t at = 0; at < whole_.size(); ++at) {
    std::string bytes = whole_;
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
    Overwrite(segment_, bytes);
    const Replay replay = ReadAll(at % 50 == 0 ? *Open() : *opened, 3, 8);
    if (at < FirstRecord()) {  // the ledger knows where the frames are
      ASSERT_TRUE(replay.bad.empty()) << at;
      continue;
    }
    const size_t frame = (at - FirstRecord()) / kRecord + 1;
    ASSERT_EQ(replay.good.size(), 7u) << at;
    ASSERT_EQ(replay.bad.size(), 1u) << at;
    ASSERT_EQ(replay.bad[0].first, frame);
    ASSERT_TRUE(absl::IsDataLoss(replay.bad[0].second));
    const std::string_view text = Message(replay.bad[0].second);
    ASSERT_NE(text.find(fmt::format("cam3.seg: frame {} ", frame)), std::string::npos) << text;
  }
}

TEST_F(HostileFiles, SwappedRecordsAreAnotherFrames) {
  std::string bytes = whole_.substr(0, FirstRecord());
  for (const size_t i : {1, 0, 2, 3, 4, 5, 6, 7}) {
    bytes += whole_.substr(FirstRecord() + i * kRecord, kRecord);
  }
  Overwrite(segment_, bytes);
  const Replay replay = ReadAll(*Open(), 3, 8);
  EXPECT_EQ(replay.good.size(), 6u);
  ASSERT_EQ(replay.bad.size(), 2u);
  EXPECT_NE(Message(replay.bad[0].second).find("another frame's"), std::string::npos);
}

TEST_F(HostileFiles, ALostSegmentCostsItsCameraOnly) {
  std::filesystem::remove(segment_);
  const auto session = Open();
  EXPECT_EQ(ReadAll(*session, 3, 8).bad.size(), 8u);
  EXPECT_EQ(ReadAll(*session, 4, 8).good.size(), 8u);
}

TEST_F(HostileFiles, PlanAndRigAreAsTheyWereOrRefused) {
  std::mt19937 random(2);
  for (const char* name : {"plan.bin", "rig.toml"}) {
    const std::string whole = *ReadFile(File(name));
    for (int i = 0; i < 300; ++i) {
      std::string bytes = whole;
      if (i % 3 == 0) {
        bytes.resize(random() % bytes.size());
      } else {
        bytes[random() % bytes.size()] ^= static_cast<char>(1 + random() % 255);
      }
      Overwrite(File(name), bytes);
      const Status status = Session::Open(folder_.path(), id_).status();
      ASSERT_TRUE(absl::IsDataLoss(status)) << status;
      ASSERT_NE(Message(status).find(name), std::string::npos) << status;
    }
    std::filesystem::remove(File(name));
    EXPECT_TRUE(absl::IsNotFound(Session::Open(folder_.path(), id_).status()));
    Overwrite(File(name), whole);
  }
}

TEST_F(HostileFiles, MutatedCompiledPlansNeverCrash) {
  const std::string whole = PackPlan(plan_);
  std::mt19937 random(3);
  for (int i = 0; i < 5000; ++i) {
    std::string bytes = whole;
    for (unsigned n = 1 + random() % 4; n > 0; --n) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    if (i % 4 == 0) bytes.resize(random() % bytes.size());
    const auto plan = UnpackPlan(bytes, rig_);
    if (!plan.ok()) {
      ASSERT_TRUE(absl::IsInvalidArgument(plan.status())) << plan.status();
    }
  }
}

TEST_F(HostileFiles, AGarbageJournalIsRefusedClearly) {
  std::mt19937 random(4);
  std::string noise(20000, '\0');
  for (char& c : noise) c = static_cast<char>(random());
  for (const std::string& bytes : {noise, std::string("hello"), noise.substr(0, 100)}) {
    Overwrite(File("journal.sqlite"), bytes);
    const Status status = Session::Open(folder_.path(), id_).status();
    ASSERT_TRUE(absl::IsDataLoss(status)) << status;
    EXPECT_NE(Message(status).find("journal.sqlite"), std::string::npos) << status;
    EXPECT_NE(Message(status).find("session journal"), std::string::npos) << status;
  }
  Overwrite(File("journal.sqlite"), "");
  EXPECT_TRUE(absl::IsDataLoss(Session::Open(folder_.path(), id_).status()));
}

// Thousands of damaged journals: refused, or what comes out is checked against its digest.
TEST_F(HostileFiles, MutatedJournalsNeverCrashAndNeverLie) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a thousand files that one thread reads: ThreadSanitizer has nothing to see there";
#endif
  const std::string whole = *ReadFile(File("journal.sqlite"));
  std::mt19937 random(5);
  int refused = 0;
  for (int i = 0; i < 1000; ++i) {
    std::string bytes = whole;
    for (unsigned n = 1 + random() % 8; n > 0; --n) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    if (i % 10 == 0) bytes.resize(random() % bytes.size());
    Overwrite(File("journal.sqlite"), bytes);
    const auto session = Session::Open(folder_.path(), id_);
    if (!session.ok()) {
      ++refused;
      continue;
    }
    for (int camera = 0; camera < 8; ++camera) {
      for (uint64_t cursor = 0; cursor < 9; ++cursor) {
        const auto frame = (*session)->Next(camera, cursor, 0);
        if (!frame.ok() || !frame->has_value()) continue;
        // (A flipped shot number in the ledger does not fit the record's.)
        ASSERT_EQ(*(*frame)->pixels, *PixelsOf(camera, (*frame)->record.shot));
      }
    }
  }
  EXPECT_GT(refused, 0);
  std::error_code ignored;
  std::filesystem::remove(File("journal.sqlite-wal"), ignored);
}

// Damaged journals of a killed session: refused, or resumed with what is whole.
TEST_F(HostileFiles, MutatedJournalsAreResumedOrRefused) {
  auto session = Session::Create(folder_.path(), plan_, rig_);
  ASSERT_TRUE(session.ok()) << session.status();
  id_ = (*session)->id();
  for (const Step& step : plan_.steps) {
    if (step.kind == StepKind::kShot && step.shot < 5) {
      ASSERT_TRUE(AppendShot(**session, step).ok());
    }
  }
  ASSERT_TRUE((*session)->Record({JournalKind::kExposure, 1, 2, 0.5, "text"}).ok());
  ASSERT_TRUE((*session)->Finish(false, "stopped", 1, 1, true).ok());
  session->reset();
  const auto original = folder_.path() / "original";
  std::filesystem::copy(folder_.path() / id_, original, std::filesystem::copy_options::recursive);
  const std::string whole = *ReadFile(File("journal.sqlite"));
  std::mt19937 random(6);
  int refused = 0, resumed = 0;
  for (int i = 0; i < 400; ++i) {
    std::filesystem::remove_all(folder_.path() / id_);
    std::filesystem::copy(original, folder_.path() / id_, std::filesystem::copy_options::recursive);
    std::string bytes = whole;
    for (unsigned n = 1 + random() % 8; n > 0; --n) {
      bytes[random() % bytes.size()] = static_cast<char>(random());
    }
    if (i % 10 == 0) bytes.resize(random() % bytes.size());
    Overwrite(File("journal.sqlite"), bytes);
    auto again = Session::Resume(folder_.path(), id_, rig_);
    if (!again.ok()) {
      ++refused;
      continue;
    }
    ++resumed;
    (void)(*again)->DropDamaged().status();
    const auto reference = (*again)->Reference();
    if (reference.ok() && reference->has_value()) {
      const FrameRecord& r = (*reference)->record;
      ASSERT_EQ(*(*reference)->pixels, *PixelsOf(r.camera, r.shot));
    }
    for (uint32_t shot = 0; shot < 8; ++shot) {
      for (const int camera : (*again)->Missing(shot)) {
        ASSERT_GE(camera, 0);
        ASSERT_LT(camera, 8);
        if (!(*again)->Append(FrameOf(camera, shot), PixelsOf(camera, shot)).ok()) break;
      }
    }
    // A complete end only when everything balances: then every shot has a frame that is whole.
    if (!(*again)->Finish(true, "", 1, 1, true).ok()) continue;
    ASSERT_EQ((*again)->Summary().end, SessionEnd::kComplete);
    for (int camera = 0; camera < 8; ++camera) {
      std::set<uint32_t> shots;
      for (const FrameRecord& r : ReadAll(**again, camera, 20).good) shots.insert(r.shot);
      ASSERT_EQ(shots.size(), 8u) << i;
    }
  }
  EXPECT_GT(refused, 0);
  EXPECT_GT(resumed, 0);
}

}  // namespace
}  // namespace mesorig::daemon
