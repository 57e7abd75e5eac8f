#include "processing/mesostructure/mdf_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <set>

#include "processing/btf/mdf_file.h"
#include "tests/processing/btf/synthetic.h"
#include "tests/processing/mesostructure/synthetic_sweep.h"

namespace mesorig::mesostructure {
namespace {

using btf::TemporaryFolder;
using ::testing::HasSubstr;

CompiledPlan PlanOf(const Rig& rig, const std::string& text) {
  auto plan = CompilePlan(text, "test.toml", rig);
  EXPECT_TRUE(plan.ok()) << plan.status();
  return std::move(plan).value();
}

// Angles of the axes at every sweep of the plan.
struct SweepAt {
  const Step* step;
  double turntable_deg, light_arc_deg;
};
std::vector<SweepAt> SweepsOf(const CompiledPlan& plan) {
  std::vector<SweepAt> sweeps;
  std::vector<double> at(2);
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kMoveAxes) at = step.axis_rad;
    if (step.kind == StepKind::kSweep) {
      sweeps.push_back({&step, DegFromRad(at[0]), DegFromRad(at[1])});
    }
  }
  return sweeps;
}

// Feeds every frame of the plan; `change` may alter the scene of a sweep.
void Feed(MdfBuilder& builder, const Rig& rig, const CompiledPlan& plan, SweepScene scene,
          const std::function<void(size_t, SweepScene&)>& change = {}) {
  std::vector<uint64_t> sequence(rig.cameras.size());
  const std::vector<SweepAt> sweeps = SweepsOf(plan);
  for (size_t k = 0; k < sweeps.size(); ++k) {
    SweepScene of = scene;
    of.turntable_deg = sweeps[k].turntable_deg, of.light_arc_deg = sweeps[k].light_arc_deg;
    of.seed = static_cast<unsigned>(k + 1);
    if (change) change(k, of);
    for (const int camera : sweeps[k].step->cameras) {
      SyntheticSweep sweep(rig, plan, *sweeps[k].step, camera, of);
      for (uint32_t i = 0; i < sweep.frames(); ++i) {
        const auto frame = sweep.Frame(i, ++sequence[static_cast<size_t>(camera)]);
        const Status status = builder.Add(frame, sweep.Pixels(i));
        ASSERT_TRUE(status.ok()) << status;
      }
    }
  }
}

// The distance along v from the centre of each texel, by marching: what the file should hold.
double TrueDistance(const Relief& relief, Vec3 texel, Vec3 v) {
  for (double d = 0; d < 40; d += 0.01) {
    const Vec3 p = texel - d * v;
    const bool inside = std::abs(p.x) <= kHalfExtentMm && std::abs(p.y) <= kHalfExtentMm;
    if (p.z <= (inside ? relief(p.x, p.y) : 0.0)) return d;
  }
  return -1;
}

struct Judged {
  double median = 0, within = 0, coverage = 0;  // mm; share within 0.3 mm; share measured
};
Judged Judge(const btf::Mdf& mdf, int view, const Relief& relief) {
  const btf::MdfHeader& h = mdf.header();
  std::vector<double> errors;
  double good = 0;
  for (int j = 0; j < h.height; ++j) {
    for (int i = 0; i < h.width; ++i) {
      const auto at = static_cast<size_t>(j * h.width + i);
      EXPECT_TRUE(std::isfinite(mdf.Distance(view)[at]) && mdf.Distance(view)[at] >= 0);
      if (!(mdf.Confidence(view)[at] > 0)) continue;
      const double truth =
          TrueDistance(relief, h.TexelCentre(i, j), h.views[static_cast<size_t>(view)]);
      errors.push_back(std::abs(static_cast<double>(mdf.Distance(view)[at]) - truth));
      good += errors.back() < 0.3 ? 1 : 0;
    }
  }
  Judged judged;
  if (errors.empty()) return judged;
  const auto count = static_cast<double>(errors.size());
  judged.coverage = count / static_cast<double>(h.texel_count());
  judged.within = good / count;
  std::nth_element(errors.begin(), errors.begin() + static_cast<ptrdiff_t>(errors.size() / 2),
                   errors.end());
  judged.median = errors[errors.size() / 2];
  return judged;
}

void ExpectRelief(const char* name, const btf::Mdf& mdf, int view, const Relief& relief,
                  double most_median_mm, double least_within, double least_coverage) {
  const Judged judged = Judge(mdf, view, relief);
  EXPECT_LT(judged.median, most_median_mm) << "view " << view;
  EXPECT_GT(judged.within, least_within) << "view " << view;
  EXPECT_GT(judged.coverage, least_coverage) << "view " << view;
  std::printf("%s, view %d: median %.3f mm, within %.3f, coverage %.3f\n", name, view,
              judged.median, judged.within, judged.coverage);
}

class MdfBuilderTest : public ::testing::Test {
 protected:
  std::unique_ptr<MdfBuilder> Builder(const CompiledPlan& plan) {
    auto builder = MdfBuilder::Create(rig_, plan, folder_ / "displacements");
    EXPECT_TRUE(builder.ok()) << builder.status();
    return std::move(builder).value();
  }
  TemporaryFolder folder_;
  const Rig rig_ = DemoRig();
};

TEST_F(MdfBuilderTest, PlaneAtKnownHeight) {
  const CompiledPlan plan =
      PlanOf(rig_, SweepPlanText("0", "90, 270", "\"cam0\", \"cam2\", \"cam5\""));
  auto builder = Builder(plan);
  SweepScene scene;
  scene.relief = [](double, double) { return 2.0; };
  Feed(*builder, rig_, plan, scene);
  MdfPackFigures figures;
  const auto mdf = builder->Build(figures);
  ASSERT_TRUE(mdf.ok()) << mdf.status();
  ASSERT_EQ(figures.views, 3);
  EXPECT_EQ(figures.images, 6u);
  for (int v = 0; v < 3; ++v) {
    ExpectRelief("plane", *mdf, v, scene.relief, 0.08, 0.97, 0.95);
  }
  // By hand: a camera 800 mm away at 60 degrees stands at (692.820, 0, 400); from (0, 0, 4.2) its
  // direction is (692.820, 0, 395.8) / 797.908 = (0.868297, 0, 0.496047). From the reference plane
  // at 4.2 mm to z = 2 along it: D = 2.2 / 0.496047 = 4.4351 mm.
  const Vec3 v = mdf->header().views[2];
  EXPECT_NEAR(v.x, 0.868297, 1e-5);
  EXPECT_NEAR(v.z, 0.496047, 1e-5);
  double sum = 0;
  for (int j = 28; j < 36; ++j) {
    for (int i = 28; i < 36; ++i) sum += static_cast<double>(mdf->Distance(2)[j * 64 + i]) / 64;
  }
  EXPECT_NEAR(sum, 4.4351, 0.05);
}

TEST_F(MdfBuilderTest, Staircase) {
  const CompiledPlan plan =
      PlanOf(rig_, SweepPlanText("0", "90, 210, 330", "\"cam0\", \"cam3\", \"cam5\""));
  auto builder = Builder(plan);
  SweepScene scene;
  scene.relief = [](double x, double) { return x < -7 ? 0.5 : x < 7 ? 1.7 : 3.2; };
  Feed(*builder, rig_, plan, scene);
  MdfPackFigures figures;
  const auto mdf = builder->Build(figures);
  ASSERT_TRUE(mdf.ok()) << mdf.status();
  for (int v = 0; v < 3; ++v) {
    ExpectRelief("stairs", *mdf, v, scene.relief, 0.1, 0.93, 0.9);
  }
}

// A raised F: not its own mirror image, nor turned by any angle.
double LetterF(double x, double y) {
  const bool stem = x > -8 && x < -4 && std::abs(y) < 12;
  const bool top = x > -8 && x < 9 && y > 8 && y < 12;
  const bool bar = x > -8 && x < 5 && y > -1 && y < 3;
  return stem || top || bar ? 3.0 : 1.0;
}

TEST_F(MdfBuilderTest, RaisedLetterIsInPlaceAndNotMirrored) {
  const CompiledPlan plan = PlanOf(rig_, SweepPlanText("30", "90, 210, 330", "\"cam0\", \"cam4\""));
  auto builder = Builder(plan);
  SweepScene scene;
  scene.relief = LetterF;
  Feed(*builder, rig_, plan, scene);
  MdfPackFigures figures;
  const auto mdf = builder->Build(figures);
  ASSERT_TRUE(mdf.ok()) << mdf.status();
  const btf::MdfHeader& h = mdf->header();
  // The second camera stands at 50 degrees; the turntable's 30 degrees turn it to azimuth -30.
  EXPECT_NEAR(h.views[1].y / h.views[1].x, std::tan(RadFromDeg(-30)), 1e-4);
  for (int v = 0; v < 2; ++v) {
    const Judged upright = Judge(*mdf, v, LetterF);
    EXPECT_LT(upright.median, 0.1) << "view " << v;
    EXPECT_GT(upright.within, 0.85) << "view " << v;
    for (const auto& turned : {Relief([](double x, double y) { return LetterF(-x, y); }),
                               Relief([](double x, double y) { return LetterF(x, -y); }),
                               Relief([](double x, double y) { return LetterF(y, x); }),
                               Relief([](double x, double y) { return LetterF(-x, -y); })}) {
      EXPECT_LT(Judge(*mdf, v, turned).within, upright.within - 0.06) << "view " << v;
    }
    std::printf("letter, view %d: median %.3f mm, within %.3f, coverage %.3f\n", v, upright.median,
                upright.within, upright.coverage);
  }
}

TEST_F(MdfBuilderTest, OneSweepThatIsWrongIsOutvoted) {
  const CompiledPlan plan = PlanOf(rig_, SweepPlanText("0", "90, 210, 330", "\"cam2\""));
  auto builder = Builder(plan);
  SweepScene scene;
  scene.relief = [](double, double) { return 2.0; };
  Feed(*builder, rig_, plan, scene, [](size_t k, SweepScene& of) {
    if (k == 1) of.relief = [](double, double) { return 3.1; };
  });
  MdfPackFigures figures;
  const auto mdf = builder->Build(figures);
  ASSERT_TRUE(mdf.ok()) << mdf.status();
  const Judged judged = Judge(*mdf, 0, scene.relief);
  EXPECT_LT(judged.median, 0.08);
  EXPECT_GT(judged.within, 0.95);
}

TEST_F(MdfBuilderTest, WhatCannotBeSeenIsHolesAndNeverNan) {
  const CompiledPlan plan = PlanOf(rig_, SweepPlanText("0", "90", "\"cam2\"", 48));
  SweepScene scene;
  scene.relief = [](double, double) { return 2.0; };
  const auto figures_of = [&](const std::function<void(SweepScene&)>& change, SweepTally& tally) {
    std::filesystem::remove_all(folder_ / "displacements");
    auto builder = Builder(plan);
    Feed(*builder, rig_, plan, scene, [&](size_t, SweepScene& of) { change(of); });
    MdfPackFigures figures;
    const auto mdf = builder->Build(figures);
    tally = builder->tally();
    if (mdf.ok()) Judge(*mdf, 0, scene.relief);
    return mdf.status();
  };
  SweepTally tally;
  EXPECT_TRUE(figures_of([](SweepScene& of) { of.peak_e = 3500; }, tally).ok());
  // No light at all, though the laser was on.
  EXPECT_EQ(figures_of([](SweepScene& of) { of.peak_e = 0; }, tally).code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(tally.refused, 48u);
  EXPECT_THAT(tally.first_refusal, HasSubstr("no stripe"));
  EXPECT_EQ(tally.images_empty, 1u);
  EXPECT_THAT(tally.first_empty, HasSubstr("0 of 48 frames"));
  // The laser off.
  EXPECT_FALSE(figures_of([](SweepScene& of) { of.laser_on = false; }, tally).ok());
  EXPECT_THAT(tally.first_refusal, HasSubstr("the laser was off"));
  // Two sheets of nearly one strength: the frames that show both are refused.
  (void)figures_of([](SweepScene& of) { of.ghost = true; }, tally);
  EXPECT_GT(tally.refused, 24u);
  // Saturated by a factor of five: the flanks still tell.
  const Status saturated = figures_of([](SweepScene& of) { of.peak_e = 100000; }, tally);
  EXPECT_TRUE(saturated.ok()) << saturated;
}

TEST_F(MdfBuilderTest, DurableImagesNeedNoFramesAgain) {
  const CompiledPlan plan = PlanOf(rig_, SweepPlanText("0", "90, 270", "\"cam2\"", 32));
  SweepScene scene;
  scene.relief = [](double x, double) { return x < 0 ? 1.0 : 2.0; };
  MdfPackFigures figures;
  std::string first, second;
  {
    auto builder = Builder(plan);
    Feed(*builder, rig_, plan, scene);
    EXPECT_EQ(builder->TakeReleasable(), (std::vector<uint32_t>{0, 1}));
    EXPECT_TRUE(builder->TakeReleasable().empty());
    ASSERT_TRUE(builder->Pack(folder_ / "a.mdf.exr", "s").ok());
  }
  auto builder = Builder(plan);
  EXPECT_EQ(builder->TakeReleasable(), (std::vector<uint32_t>{0, 1}));
  EXPECT_EQ(builder->tally().frames, builder->frames_planned());
  const auto packed = builder->Pack(folder_ / "b.mdf.exr", "s");
  ASSERT_TRUE(packed.ok()) << packed.status();
  const auto a = btf::ReadMdf(folder_ / "a.mdf.exr"), b = btf::ReadMdf(folder_ / "b.mdf.exr");
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_TRUE(std::ranges::equal(a->Distance(0), b->Distance(0)));
  EXPECT_EQ(a->header().provenance_json, b->header().provenance_json);
  // Another plan's images are not taken up.
  const CompiledPlan other = PlanOf(rig_, SweepPlanText("0", "90, 270", "\"cam2\"", 33));
  EXPECT_EQ(Builder(other)->tally().images, 0u);
  // Nor what is damaged.
  std::filesystem::resize_file(folder_ / "displacements/sweep000_cam2.mdf.exr", 700);
  EXPECT_EQ(Builder(plan)->tally().images, 1u);
}

TEST_F(MdfBuilderTest, FramesThatWereNotPlannedAreRefusedByName) {
  const CompiledPlan plan = PlanOf(rig_, SweepPlanText("0", "90", "\"cam2\"", 32));
  auto builder = Builder(plan);
  SweepScene scene;
  scene.relief = [](double, double) { return 2.0; };
  scene.light_arc_deg = 90;
  SyntheticSweep sweep(rig_, plan, *SweepsOf(plan)[0].step, 2, scene);
  const std::string pixels = sweep.Pixels(3);
  const auto message = [&](const std::function<void(SweepFrame&)>& change) {
    SweepFrame frame = sweep.Frame(3, 4);
    change(frame);
    const Status status = builder->Add(frame, pixels);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(Message(status));
  };
  EXPECT_THAT(message([](SweepFrame& f) { f.camera = 9; }), HasSubstr("camera 9"));
  EXPECT_THAT(message([](SweepFrame& f) { f.camera = 1; }), HasSubstr("does not use this camera"));
  EXPECT_THAT(message([](SweepFrame& f) { f.sweep = 7; }), HasSubstr("sweep 7"));
  EXPECT_THAT(message([](SweepFrame& f) { f.index = 32; }), HasSubstr("frame 32"));
  EXPECT_THAT(message([](SweepFrame& f) { f.shot = 5; }), HasSubstr("frame 3"));
  EXPECT_THAT(message([](SweepFrame& f) { f.mount = 0; }), HasSubstr("mount 0"));
  EXPECT_THAT(message([](SweepFrame& f) { f.sequence = 0; }), HasSubstr("sequence"));
  EXPECT_THAT(message([](SweepFrame& f) { f.axis_rad[0] = std::nan(""); }), HasSubstr("axis 0"));
  EXPECT_THAT(message([](SweepFrame& f) { f.lamp_level.clear(); }), HasSubstr("0 lamp readings"));
  EXPECT_THAT(message([](SweepFrame& f) { f.region.width -= 2; }), HasSubstr("region"));
  SweepFrame frame = sweep.Frame(3, 4);
  EXPECT_FALSE(builder->Add(frame, pixels.substr(2)).ok());
  EXPECT_EQ(builder->tally().frames, 0u);
  EXPECT_TRUE(builder->Add(frame, pixels).ok());
  EXPECT_TRUE(builder->Add(frame, pixels).ok());  // again: ignored
  frame.sequence = 5;
  EXPECT_TRUE(builder->Add(frame, pixels).ok());
  EXPECT_EQ(builder->tally().frames, 1u);
  EXPECT_EQ(builder->tally().superseded, 1u);
}

}  // namespace
}  // namespace mesorig::mesostructure
