#include "daemon/session/segment_files.h"

#include "daemon/session/released_sweeps.h"
#include "protocol/base/digest.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

const std::string kId = "a session";

// Descriptors of this process that are open on files below `folder`.
size_t OpenFilesBelow(const std::filesystem::path& folder) {
  size_t count = 0;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const auto target = std::filesystem::read_symlink(entry.path(), error);
    if (!error && target.string().starts_with(folder.string())) ++count;
  }
  return count;
}

class SegmentFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::create_directory(folder_.sweeps());
    ASSERT_TRUE(SegmentWriter::Open(folder_.segment("a"), 0, "a", 0).ok());
    ASSERT_TRUE(SegmentWriter::Open(folder_.segment("b"), 1, "b", 0).ok());
    for (uint32_t sweep = 0; sweep < 40; ++sweep) {  // two frames each
      Step step;
      step.kind = StepKind::kSweep;
      step.shot = 2 * sweep;
      step.cameras = {0, 1};
      step.sweep = {sweep, 0, 0, 0, 2, 15, false, std::vector<Region>(2)};
      plan_.steps.push_back(step);
    }
    sweeps_ = PlannedSweeps(plan_);
  }
  // Writes the camera's frame of this shot as the session's writer does.
  FrameRecord Write(SegmentWriters& writers, int camera, uint32_t shot) {
    FrameRecord record;
    record.camera = camera;
    record.shot = shot;
    record.sequence = shot + 1;
    record.segment = sweeps_.SegmentOf(camera, shot);
    record.digest = FrameDigest(*PixelsOf(camera, shot));
    record.bytes = 128;
    const auto offset = writers.Append(record, *PixelsOf(camera, shot));
    EXPECT_TRUE(offset.ok()) << offset.status();
    record.offset = *offset;
    return record;
  }

  TemporaryFolder temporary_;
  const SessionFolder folder_{temporary_.path()};
  CompiledPlan plan_;
  PlannedSweeps sweeps_;
};

TEST_F(SegmentFiles, WritersCloseASweepWithItsLastFrame) {
  auto writers = SegmentWriters::Open(folder_, {"a", "b"}, sweeps_);
  ASSERT_TRUE(writers.ok()) << writers.status();
  EXPECT_EQ(writers->open_files(), 2u);
  Write(*writers, 0, 0);
  Write(*writers, 1, 0);
  ASSERT_TRUE(writers->Sync().ok());
  EXPECT_EQ(writers->open_files(), 4u);
  Write(*writers, 0, 1);
  EXPECT_EQ(writers->open_files(), 4u) << "not before it is synced";
  ASSERT_TRUE(writers->Sync().ok());
  EXPECT_EQ(writers->open_files(), 3u);
  // Camera b never sends its last frame and goes on.
  Write(*writers, 1, 2);
  ASSERT_TRUE(writers->Sync().ok());
  EXPECT_EQ(writers->open_files(), 3u);
  // A frame that is shot again goes behind what is there.
  const FrameRecord again = Write(*writers, 0, 0);
  EXPECT_GT(again.offset, 2u * 128);
  ASSERT_TRUE(writers->Sync().ok());
  SegmentReaders readers(folder_, kId, {"a", "b"});
  const auto pixels = readers.Read(again);
  ASSERT_TRUE(pixels.ok()) << pixels.status();
  EXPECT_EQ(**pixels, *PixelsOf(0, 0));
}

TEST_F(SegmentFiles, ReadersHoldFewFilesAndNoneOfAReleasedSweep) {
  std::vector<FrameRecord> records;
  {
    auto writers = SegmentWriters::Open(folder_, {"a", "b"}, sweeps_);
    ASSERT_TRUE(writers.ok());
    for (uint32_t shot = 0; shot < 80; ++shot) {
      for (const int camera : {0, 1}) records.push_back(Write(*writers, camera, shot));
    }
    ASSERT_TRUE(writers->Sync().ok());
    EXPECT_EQ(writers->open_files(), 2u);
  }
  ASSERT_EQ(OpenFilesBelow(temporary_.path()), 0u);
  ASSERT_TRUE(MarkReleased(folder_, kId, 7).ok());
  SegmentReaders readers(folder_, kId, {"a", "b"});
  EXPECT_EQ(OpenFilesBelow(temporary_.path()), 2u) << "the main segments";
  for (int round = 0; round < 2; ++round) {
    for (const FrameRecord& record : records) {
      const auto pixels = readers.Read(record);
      ASSERT_TRUE(pixels.ok()) << pixels.status();
      ASSERT_EQ(*pixels == nullptr, record.segment == 8);
      if (*pixels) {
        ASSERT_EQ(**pixels, *PixelsOf(record.camera, record.shot));
      }
      ASSERT_LE(OpenFilesBelow(temporary_.path()), 2 + SegmentReaders::kMaxOpenSweepSegments);
    }
  }
  const size_t before = OpenFilesBelow(temporary_.path());
  readers.Release(39);
  EXPECT_EQ(OpenFilesBelow(temporary_.path()), before - 2);
  EXPECT_EQ(*readers.Read(records.back()), nullptr);
  EXPECT_EQ(readers.Released(), (std::set<uint32_t>{7, 39}));
}

TEST(PlannedSweeps, KnowsTheSweepOfAShot) {
  const Rig rig = SmallRig();
  const PlannedSweeps sweeps(SweepingPlan(rig));
  EXPECT_EQ(sweeps.OfShot(7), nullptr);
  EXPECT_EQ(sweeps.OfShot(8)->sweep, 0u);
  EXPECT_EQ(sweeps.OfShot(10)->sweep, 0u);
  EXPECT_EQ(sweeps.OfShot(11)->sweep, 1u);
  EXPECT_EQ(sweeps.OfShot(19)->sweep, 2u);
  EXPECT_EQ(sweeps.OfShot(20), nullptr);
  EXPECT_EQ(sweeps.OfShot(0xFFFFFFFF), nullptr);
  EXPECT_EQ(sweeps.SegmentOf(1, 9), 0u) << "kept";
  EXPECT_EQ(sweeps.SegmentOf(3, 12), 2u);
  EXPECT_EQ(sweeps.SegmentOf(1, 12), 0u) << "has no part in it";
  EXPECT_EQ(sweeps.Find(1)->first_shot, 11u);
  EXPECT_EQ(sweeps.Find(3), nullptr);
}

}  // namespace
}  // namespace mesorig::daemon
