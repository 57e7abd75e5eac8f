// mesorig-sim as a program: a sweep by hand over the lockstep wire, the operator, the rig's log,
// and the exact MDF.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <sstream>

#include "processing/btf/mdf_file.h"
#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_link.h"
#include "tests/end_to_end/process.h"

namespace mesorig {
namespace {

using std::chrono::milliseconds;
using test::RunProgram;
using test::Service;
using test::TemporaryFolder;
using ::testing::HasSubstr;

const std::string kSource = MESORIG_SOURCE_DIR;
const std::string kDemo = kSource + "/rigs/demo.toml",
                  kWeave = kSource + "/rigs/samples/weave.toml";
constexpr int kFrames = 8;
constexpr uint16_t kTriggerLine = 3, kLaserOnLine = 4;

struct Sweep {
  std::vector<sim_wire::CameraFrame> frames;
  std::string log;
  int laser_on_after = -1;  // half a second after the last edge
};

class Hands {  // at the buses of a simulator
 public:
  explicit Hands(const std::string& endpoint)
      : link_(sim_wire::SimLink::Connect(endpoint).value()) {
    camera_ = link_->FindDevice(sim_wire::CameraDevice("DF256-04")).value();
    nxt_ = link_->FindDevice(sim_wire::kNxtDevice).value();
    lines_ = link_->FindDevice(sim_wire::kLinesDevice).value();
    link_->Subscribe(camera_, [this](RigTime, std::string payload) {
      frames_.push_back(sim_wire::UnpackCameraFrame(payload).value());
    });
  }
  void Set(sim_wire::CameraRegister reg, double value) {
    EXPECT_TRUE(link_->Query(camera_, Pack(sim_wire::CameraAccess{reg, true, value})).ok());
  }
  void Pet() {
    for (uint8_t level : {uint8_t{0}, uint8_t{1}}) {
      EXPECT_TRUE(link_->Post(lines_, Pack(sim_wire::LineEdge{kTriggerLine, level})).ok());
    }
  }
  // Half a second of run-up, then a frame every tenth of a second.
  void SweepNow() {
    const RigClock::Member member(*link_, "hands");
    const RigClock::Activity activity(*link_, Pace::kFree);
    const char run[] = {char(0x80), 0x04, 0, 16, 0x07, 0x01, 0, 0x20, 0, 0, 0, 0};
    EXPECT_TRUE(link_->Post(nxt_, std::string(run, sizeof(run))).ok());
    for (int tenth = 0; tenth < 5 + kFrames; ++tenth) {
      Pet();
      if (tenth >= 5) {
        const auto id = static_cast<uint32_t>(tenth);
        EXPECT_TRUE(link_->Post(camera_, Pack(sim_wire::CameraTrigger{id})).ok());
      }
      link_->SleepFor(milliseconds(100));
    }
    link_->SleepFor(milliseconds(400));
  }
  int LaserOn() {
    return link_->Query(lines_, sim_wire::PackLineQuery(kLaserOnLine)).value().at(0);
  }
  std::vector<sim_wire::CameraFrame> frames() {
    std::vector<sim_wire::CameraFrame> frames;
    link_->Read([&] { frames = frames_; });
    return frames;
  }

 private:
  std::unique_ptr<sim_wire::SimLink> link_;
  uint16_t camera_ = 0, nxt_ = 0, lines_ = 0;
  std::vector<sim_wire::CameraFrame> frames_;
};

Sweep SweepWithSeed(const std::string& seed) {
  const TemporaryFolder folder;
  const std::string log = (folder / "rig.tsv").string();
  Service sim("mesorig-sim",
              {"run", "--rig", kDemo, "--sample", kWeave, "--runtime-dir", folder.path().string(),
               "--seed", seed, "--samples-per-side", "1", "--log", log},
              folder / "sim.log");
  Sweep sweep;
  if (!test::AwaitFile(folder / "mesorig-sim.endpoint")) {
    ADD_FAILURE() << sim.Log();
    return sweep;
  }
  Hands hands(FindEndpoint(folder.path(), "mesorig-sim").value());
  const auto inject = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"inject", "--runtime-dir", folder.path().string()});
    return RunProgram("mesorig-sim", words);
  };
  EXPECT_EQ(inject({"nxt", "mount", "slant"}).code, 2) << "the door is closed";
  EXPECT_EQ(inject({"operator", "remount", "ceiling"}).code, 2);
  EXPECT_EQ(inject({"operator", "remount", "slant"}).code, 0);
  hands.Set(sim_wire::CameraRegister::kExposureS, 0.02);
  hands.Set(sim_wire::CameraRegister::kRegionHeight, 100);
  hands.Set(sim_wire::CameraRegister::kRegionY, 40);
  hands.SweepNow();
  sweep.frames = hands.frames();
  sweep.laser_on_after = hands.LaserOn();
  EXPECT_EQ(sim.End(SIGTERM), 0) << sim.Log();
  sweep.log = ReadFile(log).value();
  return sweep;
}

// Mean row of what is well above the black level. (The light arc stands near its home: the stripe
// runs along the rows.)
double StripeRow(const sim_wire::CameraFrame& frame) {
  double sum = 0, moment = 0;
  for (size_t i = 0; i + 1 < frame.pixels.size(); i += 2) {
    const int dn = static_cast<unsigned char>(frame.pixels[i]) |
                   static_cast<unsigned char>(frame.pixels[i + 1]) << 8;
    if (dn < 64 + 200) continue;
    sum += dn;
    moment += dn * static_cast<double>(i / 2 / frame.width);
  }
  return sum > 0 ? moment / sum : -1;
}

TEST(LaserProgram, SweepsAndLogsAndRepeatsItself) {
  const Sweep first = SweepWithSeed("7"), again = SweepWithSeed("7"), other = SweepWithSeed("8");
  ASSERT_EQ(first.frames.size(), size_t{kFrames});
  ASSERT_EQ(again.frames.size(), size_t{kFrames});
  ASSERT_EQ(other.frames.size(), size_t{kFrames});
  for (size_t i = 0; i < first.frames.size(); ++i) {
    EXPECT_EQ(first.frames[i].height, 100);
    EXPECT_EQ(FrameDigest(first.frames[i].pixels), FrameDigest(again.frames[i].pixels)) << i;
    EXPECT_NE(FrameDigest(first.frames[i].pixels), FrameDigest(other.frames[i].pixels)) << i;
    EXPECT_GT(StripeRow(first.frames[i]), 0) << "the stripe is in the picture";
  }
  EXPECT_GT(std::abs(StripeRow(first.frames.front()) - StripeRow(first.frames.back())), 5)
      << "it moves";
  EXPECT_EQ(first.laser_on_after, 0);
  // On with the first edge, off a quarter of a second after the last one at 1.2 s.
  EXPECT_THAT(first.log, HasSubstr("0.000000000\tmount\tslant\n"));
  EXPECT_THAT(first.log, HasSubstr("0.000000000\tmotor\trun 16 %\n0.000000000\tlaser\ton\n"));
  EXPECT_THAT(first.log, HasSubstr("1.450000000\tlaser\toff\n"));
  EXPECT_EQ(first.log, again.log);
}

TEST(LaserProgram, TruthOfAnMdfAndOfTheMesh) {
  const TemporaryFolder folder;
  btf::MdfHeader header;
  header.width = header.height = 16;
  header.pitch_mm = 2.5;
  header.h_ref_mm = 4.2;
  header.views = {Vec3{0, 0, 1}, Vec3{0.6, 0, 0.8}};
  const std::string like = (folder / "like.mdf.exr").string(),
                    out = (folder / "t.mdf.exr").string();
  const std::string mesh = (folder / "weave.obj").string();
  ASSERT_TRUE(btf::WriteMdf(btf::Mdf(header), like).ok());
  const auto outcome = RunProgram("mesorig-sim", {"truth", "--sample", kWeave, "--like", like,
                                                  "--out", out, "--mesh", mesh, "--json"});
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  EXPECT_THAT(outcome.text, HasSubstr("\"views\": 2"));
  const btf::Mdf truth = btf::ReadMdf(out).value();
  double highest = 100;
  for (int v = 0; v < 2; ++v) {
    for (size_t i = 0; i < header.texel_count(); ++i) {
      EXPECT_EQ(truth.Confidence(v)[i], 1);
      EXPECT_LE(truth.Distance(v)[i] * header.views[static_cast<size_t>(v)].z, 4.2001);
      highest = std::min<double>(highest, truth.Distance(v)[i]);
    }
  }
  EXPECT_LT(highest, 1.5) << "the letter's top is at 3.2 mm";
  EXPECT_GT(std::filesystem::file_size(mesh), 1000000u);
  EXPECT_EQ(RunProgram("mesorig-sim", {"truth", "--sample", kWeave}).code, 2);
  EXPECT_EQ(RunProgram("mesorig-sim", {"truth", "--sample", kWeave, "--like", like}).code, 2);
}

}  // namespace
}  // namespace mesorig
