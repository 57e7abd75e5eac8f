#include "processing/assemble/assembler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <random>

#include "processing/assemble/irradiance.h"
#include "processing/btf/btf_file.h"
#include "protocol/rig/rig_geometry.h"
#include "tests/processing/assemble/synthetic_session.h"

namespace mesorig::assemble {
namespace {

using ::testing::HasSubstr;

class AssemblerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    dir_ = std::filesystem::path(::testing::TempDir()) /
           fmt::format("assembler_{}_{}", ::getpid(),
                       ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(dir_);
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }
  std::unique_ptr<Assembler> Make(const std::string& plan_text) {
    auto plan = CompilePlan(plan_text, "test.toml", rig_);
    EXPECT_TRUE(plan.ok()) << plan.status();
    plan_ = *plan;
    auto made = Assembler::Create(rig_, *plan, dir_ / "work");
    EXPECT_TRUE(made.ok()) << made.status();
    return std::move(made).value();
  }
  // What the plan commands for a shot.
  Shot Planned(uint32_t shot) const {
    Shot at;
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kMoveAxes) {
        at.turntable_deg = DegFromRad(step.axis_rad[0]), at.light_arc_deg = DegFromRad(step.axis_rad[1]);
      }
      if (step.kind == StepKind::kLamp) at.lamp = step.lamp;
      if (step.kind == StepKind::kShot && step.shot == shot) return at;
    }
    ADD_FAILURE() << "no shot " << shot;
    return at;
  }
  btf::SampledBtf Built(const Assembler& assembler) {
    auto built = assembler.BuildBtf(figures_);
    EXPECT_TRUE(built.ok()) << built.status();
    return std::move(built).value();
  }

  std::filesystem::path dir_;
  Rig rig_ = DemoRig();
  CompiledPlan plan_;
  PackFigures figures_;
};

// By hand: lamp5 (theta 60 degrees, 650 mm) with the arc at 90 and the turntable at 30 degrees
// stands at (281.458256, 487.5, 325) mm of the sample. Texel (52, 21) of 64 x 64 at 0.5 mm is
// centred at (10.25, 5.25, 4.5): d = (271.208256, 482.25, 320.5), d^2 = 0.40883923 m^2,
// E = (24, 20, 14) / d^2 = (58.70279, 48.91899, 34.24329) W m^-2. Code 2064 at 20 ms is
// (2064 - 64) / 4031 * 20000 / (40000 * 0.02) = 12.403870 W m^-2 sr^-1.
TEST_F(AssemblerTest, GoldenValueByHand) {
  auto assembler = Make(PlanText("30", "90", "\"lamp5\"", "\"cam5\"", 64, 0.5));
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, {30, 90, 5}, 5, 0, 1), Uniform(rig_.cameras[5], 2064)).ok());
  const btf::SampledBtf btf = Built(*assembler);
  ASSERT_EQ(btf.present_count(), 1u);
  const float* value = btf.Image(0, 0).data() + 3 * (21 * 64 + 52);
  EXPECT_NEAR(value[0], 12.403870 / 58.70279, 1e-6);
  EXPECT_NEAR(value[1], 12.403870 / 48.91899, 1e-6);
  EXPECT_NEAR(value[2], 12.403870 / 34.24329, 1e-6);
  const btf::BtfHeader& header = btf.header();
  EXPECT_NEAR(header.view_positions_mm[0].x, 600, 1e-5);
  EXPECT_NEAR(header.view_positions_mm[0].y, -346.410162, 1e-5);
  EXPECT_NEAR(header.light_positions_mm[0].y, 487.5, 1e-5);
  // From the centre of the reference plane: (281.458256, 487.5, 320.5) / 647.7627.
  EXPECT_NEAR(header.lights[0].z, 320.5 / 647.7627, 1e-6);
}

// By hand, as in the rig's golden tests but at z = 4.5: the point (10.25, 5.25, 4.5) with the
// turntable at 30 degrees is (6.2517604, 9.6716334, 4.5) in the world; cam5 (theta 60) sees it at
//   depth = 800 - (0.8660254 * 6.2517604 + 0.5 * 4.5) = 792.3358167
//   u = 128 + 2600 * 9.6716334 / 792.3358167 = 159.736855
//   v =  96 + 2600 * (0.5 * 6.2517604 - 0.8660254 * 4.5) / 792.3358167 = 93.469252
// A spot there must lie at texel (52, 21), whose centre is (52.5, 21.5) in texels.
TEST_F(AssemblerTest, GoldenPixelIsItsTexel) {
  auto assembler = Make(PlanText("30", "90", "\"lamp5\"", "\"cam5\"", 64, 0.5));
  std::string bytes = Uniform(rig_.cameras[5], 64);
  for (int row = 80; row < 108; ++row) {
    for (int column = 145; column < 175; ++column) {
      const double du = column + 0.5 - 159.736855, dv = row + 0.5 - 93.469252;
      const int code = 64 + static_cast<int>(std::lround(3000 * std::exp(-(du * du + dv * dv) / 18)));
      const size_t at = 2 * static_cast<size_t>(row * 256 + column);
      bytes[at] = static_cast<char>(code & 0xff), bytes[at + 1] = static_cast<char>(code >> 8);
    }
  }
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, {30, 90, 5}, 5, 0, 1), bytes).ok());
  const btf::SampledBtf btf = Built(*assembler);
  double sum = 0, x = 0, y = 0;
  for (int t = 0; t < 64 * 64; ++t) {
    const double value = btf.Image(0, 0)[static_cast<size_t>(3 * t + 1)];
    sum += value, x += value * (t % 64 + 0.5), y += value * (t / 64 + 0.5);
  }
  EXPECT_NEAR(x / sum, 52.5, 0.05);
  EXPECT_NEAR(y / sum, 21.5, 0.05);
}

double Smooth(double x, double y, int c) {
  return 0.12 + 0.03 * c + 0.05 * std::sin(0.35 * x + 0.11 * y + c) + 0.03 * std::cos(0.2 * x - 0.5 * y);
}
// A letter F, 12 mm tall, upright with +y up.
bool InLetter(double x, double y) {
  if (x < -4 || x > 4 || y < -6 || y > 6) return false;
  return x < -1.5 || y > 3.5 || (y > -1 && y < 1.5 && x < 2.5);
}

struct Pose {
  double turntable_deg;
  int camera;
};
class PoseTest : public AssemblerTest, public ::testing::WithParamInterface<Pose> {};

TEST_P(PoseTest, TextureComesBackAtItsTexels) {
  const Pose pose = GetParam();
  auto assembler = Make(PlanText(fmt::format("{}", pose.turntable_deg), "90", "\"lamp2\"",
                                 fmt::format("\"cam{}\"", pose.camera), 40, 0.8));
  const Shot shot{pose.turntable_deg, 90, 2};
  const size_t camera = static_cast<size_t>(pose.camera);
  const std::string bytes = Render(rig_.cameras[camera], kCameraThetaDeg[camera], shot, Smooth);
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, shot, pose.camera, 0, 1), bytes).ok());
  const btf::SampledBtf btf = Built(*assembler);
  double worst = 0;
  for (int t = 0; t < 40 * 40; ++t) {
    const Vec3 p = btf.header().TexelCentre(t % 40, t / 40);
    for (int c = 0; c < 3; ++c) {
      const double value = btf.Image(0, 0)[static_cast<size_t>(3 * t + c)];
      worst = std::max(worst, std::abs(value - Smooth(p.x, p.y, c)));
    }
  }
  EXPECT_LT(worst, 0.003) << "of values around 0.15";
}

TEST_P(PoseTest, LetterIsNotMirrored) {
  const Pose pose = GetParam();
  auto assembler = Make(PlanText(fmt::format("{}", pose.turntable_deg), "90", "\"lamp2\"",
                                 fmt::format("\"cam{}\"", pose.camera), 40, 0.8));
  const Shot shot{pose.turntable_deg, 90, 2};
  const size_t camera = static_cast<size_t>(pose.camera);
  const std::string bytes =
      Render(rig_.cameras[camera], kCameraThetaDeg[camera], shot,
             [](double x, double y, int) { return InLetter(x, y) ? 0.25 : 0.05; });
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, shot, pose.camera, 0, 1), bytes).ok());
  const btf::SampledBtf btf = Built(*assembler);
  int wrong = 0, letter = 0;
  for (int t = 0; t < 40 * 40; ++t) {
    const Vec3 p = btf.header().TexelCentre(t % 40, t / 40);
    letter += InLetter(p.x, p.y) ? 1 : 0;
    wrong += (btf.Image(0, 0)[static_cast<size_t>(3 * t + 1)] > 0.15) != InLetter(p.x, p.y) ? 1 : 0;
  }
  EXPECT_GT(letter, 70);
  EXPECT_LE(wrong, letter / 10) << "of " << letter << " texels of the letter";
}

INSTANTIATE_TEST_SUITE_P(Poses, PoseTest,
                         ::testing::Values(Pose{0, 0}, Pose{30, 0}, Pose{0, 3}, Pose{30, 5},
                                           Pose{150, 5}, Pose{270, 2}));

// A Lambert plane: L = rho / pi E cos(theta_l), so the value is rho / pi cos(theta_l) with the
// texel's own angle: lamps are near, the angle differs over the crop.
TEST_F(AssemblerTest, LambertPlane) {
  auto assembler = Make(PlanText("60", "90", "\"lamp0\", \"lamp5\", \"lamp7\"", "\"cam4\"", 32, 0.9));
  const double rho[3] = {0.7, 0.5, 0.3};
  for (uint32_t k = 0; k < 3; ++k) {
    const Shot shot = Planned(k);
    const Vec3 lamp = LampOf(shot);
    const std::string bytes = Render(rig_.cameras[4], 50, shot, [&](double x, double y, int c) {
      const double d = std::sqrt((lamp.x - x) * (lamp.x - x) + (lamp.y - y) * (lamp.y - y) +
                                 (lamp.z - 4.5) * (lamp.z - 4.5));
      return rho[c] / kPi * (lamp.z - 4.5) / d;
    });
    ASSERT_TRUE(assembler->Add(InfoOf(rig_, shot, 4, k, k + 1), bytes).ok());
  }
  const btf::SampledBtf btf = Built(*assembler);
  ASSERT_EQ(btf.header().light_count(), 3);
  for (int l = 0; l < 3; ++l) {
    for (int t = 0; t < 32 * 32; ++t) {
      const Vec3 p = btf.header().TexelCentre(t % 32, t / 32);
      for (int c = 0; c < 3; ++c) {
        const double expected = rho[c] / kPi * btf.header().LightAt(l, p).z;
        ASSERT_NEAR(btf.Image(0, l)[static_cast<size_t>(3 * t + c)], expected, 1e-3 * expected + 1e-4)
            << "light " << l << ", texel " << t;
      }
    }
  }
}

// cam0 at the zenith is one view at both turntable angles; azimuths of the light: 30 and 90 at
// turntable 0, -30 and 30 at 60.
TEST_F(AssemblerTest, MergesWhatCoincidesAndLeavesTheRestAbsent) {
  auto assembler = Make(PlanText("0, 60", "30, 90", "\"lamp3\"", "\"cam0\", \"cam4\"", 16, 1.0));
  ASSERT_EQ(assembler->frames_planned(), 8u);
  for (uint32_t k = 0; k < 4; ++k) {
    const Shot shot = Planned(k);
    const int code = shot.turntable_deg > 1 ? 2064 : 1064;  // 1500 on average where merged
    for (const int camera : {0, 4}) {
      ASSERT_TRUE(assembler->Add(InfoOf(rig_, shot, camera, k, k + 1),
                                 Uniform(rig_.cameras[static_cast<size_t>(camera)], code)).ok());
    }
  }
  const btf::SampledBtf btf = Built(*assembler);
  ASSERT_EQ(btf.header().view_count(), 3);
  ASSERT_EQ(btf.header().light_count(), 3);
  EXPECT_EQ(figures_.pairs, 7u);
  EXPECT_EQ(figures_.merged_frames, 1u);
  EXPECT_NEAR(btf.header().views[0].z, 1, 1e-9);
  int merged = 0;
  for (int l = 0; l < 3; ++l) {
    ASSERT_TRUE(btf.Present(0, l));
    const Vec3 p = btf.header().TexelCentre(3, 7);
    const Vec3 lamp = btf.header().light_positions_mm[static_cast<size_t>(l)];
    const double e = 20 / (1e-6 * Dot(lamp - p, lamp - p));
    const double azimuth = DegFromRad(std::atan2(lamp.y, lamp.x));
    const double code = azimuth > 60 ? 1000 : azimuth < 0 ? 2000 : 1500;
    merged += code == 1500 ? 1 : 0;
    EXPECT_NEAR(btf.Image(0, l)[3 * (7 * 16 + 3) + 1], code / 4031 * 25 / e, 1e-6);
  }
  EXPECT_EQ(merged, 1);
  int absent = 0;
  for (int v = 1; v < 3; ++v) {
    for (int l = 0; l < 3; ++l) absent += btf.Present(v, l) ? 0 : 1;
  }
  EXPECT_EQ(absent, 2);
}

TEST_F(AssemblerTest, OrderOfArrivalDoesNotMatter) {
  const std::string text = PlanText("0, 60", "30, 90", "\"lamp3\"", "\"cam0\", \"cam4\"", 16, 1.0);
  std::vector<float> first;
  for (const bool backwards : {false, true}) {
    auto assembler = Make(text);
    for (uint32_t n = 0; n < 8; ++n) {
      const uint32_t k = backwards ? 7 - n : n;
      const int camera = k % 2 == 0 ? 0 : 4;
      ASSERT_TRUE(assembler->Add(InfoOf(rig_, Planned(k / 2), camera, k / 2, k / 2 + 1),
                                 Uniform(rig_.cameras[0], 700 + 331 * static_cast<int>(k))).ok());
    }
    const btf::SampledBtf btf = Built(*assembler);
    std::vector<float> values;
    for (int v = 0; v < 3; ++v) {
      for (int l = 0; l < 3; ++l) values.insert(values.end(), btf.Image(v, l).begin(), btf.Image(v, l).end());
    }
    EXPECT_TRUE(!backwards || values == first);
    first = values;
  }
}

TEST_F(AssemblerTest, ALaterFrameReplacesAnEarlierOne) {
  auto assembler = Make(PlanText("0", "90", "\"lamp3\"", "\"cam0\"", 16, 1.0));
  const auto add = [&](uint64_t sequence, int code) {
    return assembler->Add(InfoOf(rig_, {0, 90, 3}, 0, 0, sequence), Uniform(rig_.cameras[0], code));
  };
  ASSERT_TRUE(add(1, 1000).ok());
  const float before = Built(*assembler).Image(0, 0)[0];
  ASSERT_TRUE(add(5, 2000).ok());
  const float after = Built(*assembler).Image(0, 0)[0];
  EXPECT_NEAR(after / before, 1936.0 / 936.0, 1e-5);
  ASSERT_TRUE(add(2, 3000).ok()) << "late and replaced already";
  EXPECT_EQ(Built(*assembler).Image(0, 0)[0], after);
  EXPECT_EQ(assembler->tally().frames, 1u);
  EXPECT_EQ(assembler->tally().superseded, 1u);
}

TEST_F(AssemblerTest, RefusesFramesThatCannotBeValues) {
  auto assembler = Make(PlanText("0", "90", "\"lamp3\", \"lamp4\"", "\"cam0\"", 16, 1.0));
  FrameInfo two = InfoOf(rig_, {0, 90, 3}, 0, 0, 1);
  two.lamp_level[6] = 0.05;
  ASSERT_TRUE(assembler->Add(two, Uniform(rig_.cameras[0], 1000)).ok());
  EXPECT_EQ(assembler->tally().refused, 1u);
  EXPECT_THAT(assembler->tally().first_refusal, HasSubstr("camera 0, shot 0: lamp lamp3 gives"));
  FrameInfo dark = InfoOf(rig_, {0, 90, 4}, 0, 1, 2);
  dark.lamp_level.assign(8, 0.0);
  ASSERT_TRUE(assembler->Add(dark, Uniform(rig_.cameras[0], 1000)).ok());
  EXPECT_EQ(assembler->tally().refused, 2u);
  EXPECT_THAT(std::string(assembler->BuildBtf(figures_).status().message()), HasSubstr("2 refused"));
  FrameInfo faint = InfoOf(rig_, {0, 90, 3}, 0, 0, 3);  // shot again; a lamp's glow is counted
  faint.lamp_level[6] = 0.0005;
  ASSERT_TRUE(assembler->Add(faint, Uniform(rig_.cameras[0], 1000)).ok());
  EXPECT_EQ(assembler->tally().refused, 1u);
  EXPECT_EQ(Built(*assembler).present_count(), 1u);
}

TEST_F(AssemblerTest, RefusesATexelOutOfThePicture) {
  auto assembler = Make(PlanText("0", "90", "\"lamp3\"", "\"cam0\"", 64, 1.0));  // 64 mm; 59 are seen
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, {0, 90, 3}, 0, 0, 1), Uniform(rig_.cameras[0], 1000)).ok());
  EXPECT_THAT(assembler->tally().first_refusal, HasSubstr("does not see all of texel (0, 0)"));
}

TEST_F(AssemblerTest, CountsClippedTexelsAndKeepsTheirLowerBound) {
  auto assembler = Make(PlanText("0", "90", "\"lamp3\"", "\"cam0\"", 16, 1.0));
  std::string bytes = Uniform(rig_.cameras[0], 1000);
  const size_t at = 2 * (96 * 256 + 128);  // in the middle: at the corner of four texels
  bytes[at] = static_cast<char>(0xff), bytes[at + 1] = 0x0f;
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, {0, 90, 3}, 0, 0, 1), bytes).ok());
  EXPECT_GE(assembler->tally().clipped_texels, 4u);
  EXPECT_LE(assembler->tally().clipped_texels, 16u);
  const btf::SampledBtf btf = Built(*assembler);
  EXPECT_GT(btf.Image(0, 0)[3 * (8 * 16 + 8)], 1.02 * btf.Image(0, 0)[0]);
}

TEST_F(AssemblerTest, WritesTheFileWithItsProvenance) {
  auto assembler = Make(PlanText("0", "90", "\"lamp3\", \"lamp4\"", "\"cam0\"", 16, 1.0));
  EXPECT_TRUE(absl::IsFailedPrecondition(assembler->Pack(dir_ / "a.btf.exr", "s1").status()));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "a.btf.exr"));
  ASSERT_TRUE(assembler->Add(InfoOf(rig_, {0, 90, 3}, 0, 0, 1), Uniform(rig_.cameras[0], 1000)).ok());
  auto figures = assembler->Pack(dir_ / "a.btf.exr", "s1");
  ASSERT_TRUE(figures.ok()) << figures.status();
  EXPECT_EQ(figures->bytes, std::filesystem::file_size(dir_ / "a.btf.exr"));
  const auto read = btf::ReadSampledBtf(dir_ / "a.btf.exr");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_THAT(read->header().provenance_json, HasSubstr("\"session\":\"s1\""));
  EXPECT_THAT(read->header().provenance_json, HasSubstr(rig_.sha256));
  EXPECT_THAT(read->header().provenance_json, HasSubstr("\"frames\":1"));
  EXPECT_EQ(read->header().view_positions_mm.size(), 1u);
}

// What comes from outside: thousands of malformed readings and pixels never crash and leave no NaN.
TEST_F(AssemblerTest, SurvivesMalformedFrames) {
  auto assembler = Make(PlanText("0, 60", "90", "\"lamp3\", \"lamp4\"", "\"cam0\", \"cam4\"", 8, 1.0));
  std::mt19937 random(7);
  const double odd[] = {0, -1, 1e308, -1e308, 1e-300, std::nan(""), INFINITY, 0.02, 3};
  std::string pixels = Uniform(rig_.cameras[0], 1000);
  int accepted = 0;
  for (int round = 0; round < 2000; ++round) {
    FrameInfo info = InfoOf(rig_, {0, 90, 3}, 0, 0, 1 + static_cast<uint64_t>(round));
    std::string bytes = pixels;
    switch (random() % 7) {
      case 0: info.camera = static_cast<int>(random() % 12) - 2; break;
      case 1: info.shot = static_cast<uint32_t>(random() % 6); break;
      case 2: info.exposure_s = odd[random() % 9]; break;
      case 3: info.axis_rad[random() % 2] = odd[random() % 9]; break;
      case 4: info.lamp_level[random() % 8] = odd[random() % 9]; break;
      case 5: info.axis_rad.resize(random() % 4), info.lamp_level.resize(random() % 10); break;
      default:
        bytes.resize(random() % 2 == 0 ? bytes.size() : random() % bytes.size());
        for (int k = 0; k < 40; ++k) bytes[random() % bytes.size()] = static_cast<char>(random() & 0x0f);
    }
    accepted += assembler->Add(info, bytes).ok() ? 1 : 0;
  }
  EXPECT_GT(accepted, 300);
  const auto built = assembler->BuildBtf(figures_);
  if (!built.ok()) return;
  for (int v = 0; v < built->header().view_count(); ++v) {
    for (int l = 0; l < built->header().light_count(); ++l) {
      for (const float value : built->Image(v, l)) ASSERT_TRUE(std::isfinite(value));
    }
  }
}

}  // namespace
}  // namespace mesorig::assemble
