// A consumer that keeps up takes frames from memory, one that does not from the disk: both see the
// same.

#include "daemon/session/recent_frames.h"

#include "daemon/session/session_folder.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

FrameRecord Numbered(int camera, uint64_t sequence) {
  FrameRecord record = FrameOf(camera, static_cast<uint32_t>(sequence));
  record.sequence = sequence;
  return record;
}

void Add(RecentFrames& recent, int camera, uint64_t sequence, size_t bytes) {
  recent.Add(Numbered(camera, sequence), PixelsOf(camera, static_cast<uint32_t>(sequence), bytes));
}

TEST(RecentFrames, KeepsTheNewestOfEachCamera) {
  RecentFrames recent(2, 2000);  // 1000 a camera
  for (uint64_t sequence = 1; sequence <= 7; ++sequence) Add(recent, 0, sequence, 300);
  Add(recent, 1, 40, 1000);
  for (uint64_t sequence = 1; sequence <= 8; ++sequence) {
    const auto frame = recent.Find(0, sequence);
    ASSERT_EQ(frame.has_value(), sequence >= 5 && sequence <= 7) << sequence;
    if (!frame) continue;
    EXPECT_EQ(frame->record.sequence, sequence);
    EXPECT_EQ(*frame->pixels, *PixelsOf(0, static_cast<uint32_t>(sequence), 300));
  }
  EXPECT_TRUE(recent.Find(1, 40).has_value());
  EXPECT_FALSE(recent.Find(1, 41).has_value());
}

TEST(RecentFrames, AFrameLargerThanItsShareIsNotKept) {
  RecentFrames recent(1, 1000);
  Add(recent, 0, 1, 1001);
  EXPECT_FALSE(recent.Find(0, 1).has_value());
  Add(recent, 0, 2, 1000);
  EXPECT_TRUE(recent.Find(0, 2).has_value());
}

TEST(RecentFrames, AGapForgetsWhatWasBefore) {
  RecentFrames recent(1, 1000);
  Add(recent, 0, 1, 10);
  Add(recent, 0, 3, 10);
  EXPECT_FALSE(recent.Find(0, 1).has_value());
  EXPECT_FALSE(recent.Find(0, 2).has_value());
  EXPECT_TRUE(recent.Find(0, 3).has_value());
}

TEST(RecentFrames, CamerasThatAreNotThereAndAnEmptyOne) {
  RecentFrames none(0, 1000), recent(1, 1000);
  Add(none, 0, 1, 10);
  Add(recent, -1, 1, 10);
  Add(recent, 1, 1, 10);
  EXPECT_FALSE(none.Find(0, 1).has_value());
  EXPECT_FALSE(recent.Find(-1, 1).has_value());
  EXPECT_FALSE(recent.Find(1, 1).has_value());
  Add(recent, 0, 1, 10);
  recent.Clear();
  EXPECT_FALSE(recent.Find(0, 1).has_value());
}

// What a segment lost is told from the disk's side (verify, resume); a consumer beside the writer
// still gets the frame, as it was appended.
TEST(RecentFrames, AreWhatAConsumerBesideTheWriterGets) {
  TemporaryFolder folder;
  const Rig rig = SmallRig();
  const CompiledPlan plan = SmallPlan(rig);
  const auto session = Session::Create(folder.path(), plan, rig, {}).value();
  ASSERT_TRUE(AppendAll(*session, plan).ok());
  ASSERT_TRUE(session->Flush().ok());
  const std::vector<uint32_t> beside = ShotsOf(*session, 2).value();
  EXPECT_EQ(beside.size(), plan.shots);
  std::filesystem::resize_file(
      SessionFolder(folder.path() / session->id()).segment(rig.cameras[2].name), 100);
  EXPECT_EQ(ShotsOf(*session, 2).value(), beside);
  EXPECT_FALSE(session->Finish(true, "", 1, 1, true).ok());  // (it counts what the disk has)
  EXPECT_TRUE(absl::IsDataLoss(ShotsOf(*session, 2).status()));
  EXPECT_EQ(ShotsOf(*session, 3).value(), beside);
}

}  // namespace
}  // namespace mesorig::daemon
