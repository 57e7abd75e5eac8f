#include "daemon/control/frame_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/daemon/fakes/bench.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

struct WrongFrame {
  const char* says;
  std::function<void(CapturedFrame&)> make;
};

const WrongFrame kWrong[] = {
    {"it is of trigger 8", [](CapturedFrame& frame) { frame.trigger_id = 8; }},
    {"duplicated", [](CapturedFrame& frame) { frame.frame_id = 4; }},
    {"stale", [](CapturedFrame& frame) { frame.exposure_start = milliseconds(900); }},
    {"its clock jumped", [](CapturedFrame& frame) { frame.exposure_start = milliseconds(90000); }},
    {"trigger_latency_s", [](CapturedFrame& frame) { frame.exposure_start += milliseconds(100); }},
    {"torn: 16 x 8 pixels of 12 bits, 100 bytes",
     [](CapturedFrame& frame) { frame.pixels = std::make_shared<std::string>(100, 'x'); }},
    {"torn: 16 x 8 pixels of 12 bits, 0 bytes", [](CapturedFrame& frame) { frame.pixels = {}; }},
    {"torn: 8 x 8", [](CapturedFrame& frame) { frame.width = 8; }},
    {"torn", [](CapturedFrame& frame) { frame.bits = 8; }},
};

CapturedFrame GoodFrame() {
  return {7,
          5,
          milliseconds(1000),
          milliseconds(1020),
          16,
          8,
          12,
          std::make_shared<std::string>(256, 'x')};
}

TEST(FrameCheck, NamesWhatIsWrong) {
  const Rig rig = SmallRig();
  const ExpectedFrame expected{7, milliseconds(1000), milliseconds(1500), 4, {0, 0, 16, 8}};
  const RigTime now = milliseconds(1050);
  EXPECT_EQ(CheckFrame(rig.cameras[0], expected, GoodFrame(), now), OkStatus());
  for (const WrongFrame& wrong : kWrong) {
    CapturedFrame frame = GoodFrame();
    wrong.make(frame);
    const Status status = CheckFrame(rig.cameras[0], expected, frame, now);
    EXPECT_TRUE(absl::IsDataLoss(status)) << wrong.says;
    EXPECT_THAT(std::string(Message(status)), HasSubstr(wrong.says));
    EXPECT_THAT(std::string(Message(status)), HasSubstr("camera C0: "));
  }
  const Status late = CheckFrame(rig.cameras[0], expected, GoodFrame(), milliseconds(1501));
  EXPECT_THAT(std::string(Message(late)), HasSubstr("late: came at 1.501"));
}

// Each of them in a run: noted, thrown away and shot again, and nothing wrong in the ledger.
TEST(FrameCheck, ARunShootsWrongFramesAgain) {
  for (const WrongFrame& wrong : kWrong) {
    SCOPED_TRACE(wrong.says);
    Bench bench;
    // Frame ids count from 1 and the warm-up's was 1: the shot's is 2.
    bench.cameras[1]->tampered[2] = [&](CapturedFrame& frame) {
      wrong.make(frame);
      if (std::string(wrong.says) == "duplicated") frame.frame_id = 1;
      if (std::string(wrong.says) == "stale") frame.exposure_start = RigTime(0);
    };
    const SequencerEvent end = bench.Run(SmallPlan(bench.rig));
    EXPECT_TRUE(end.complete) << end.text;
    EXPECT_GE(bench.session->Journaled(JournalKind::kNote), 1);
    EXPECT_EQ(bench.session->Journaled(JournalKind::kRecovered), 0);
    const auto records = bench.session->records();
    ASSERT_EQ(records.size(), 5u);
    EXPECT_EQ(records[0].trigger_id, 2u);
    EXPECT_EQ(records[1].camera, 1);
    EXPECT_EQ(records[1].trigger_id, 3u) << "again, with the camera that owes it alone";
  }
}

}  // namespace
}  // namespace mesorig::daemon
