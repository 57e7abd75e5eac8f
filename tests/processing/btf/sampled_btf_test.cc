#include "processing/btf/sampled_btf.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "tests/processing/btf/synthetic.h"

namespace mesorig::btf {
namespace {

using ::testing::HasSubstr;

BtfHeader Header() { return SmallHeader(4, 2, RingDirections(1, 4, 40), RingDirections(1, 3, 50)); }

TEST(BtfHeader, TexelCentresRunFromTopLeft) {
  const BtfHeader header = Header();  // 4 x 2 texels of 0.5 mm
  EXPECT_EQ(header.TexelCentre(0, 0), (Vec3{-0.75, 0.25, 3.25}));
  EXPECT_EQ(header.TexelCentre(3, 1), (Vec3{0.75, -0.25, 3.25}));
}

TEST(BtfHeader, DirectionFromANearCamera) {
  BtfHeader header = Header();
  header.view_positions_mm.assign(header.views.size(), Vec3{0, 0, 103.25});
  const Vec3 v = header.ViewAt(0, {75, 0, 3.25});  // a 3-4-5 triangle
  EXPECT_NEAR(v.x, -0.6, 1e-12);
  EXPECT_NEAR(v.z, 0.8, 1e-12);
  EXPECT_EQ(header.LightAt(1, {75, 0, 3.25}), header.lights[1]);
}

TEST(CheckHeader, RefusesWhatIsWrong) {
  EXPECT_TRUE(CheckHeader(Header()).ok());
  const auto message = [](auto change) {
    BtfHeader header = Header();
    change(header);
    return std::string(Message(CheckHeader(header)));
  };
  EXPECT_THAT(message([](auto& h) { h.width = 0; }), HasSubstr("0 x 2 texels"));
  EXPECT_THAT(message([](auto& h) { h.height = 16385; }), HasSubstr("16385"));
  EXPECT_THAT(message([](auto& h) { h.views.clear(); }), HasSubstr("0 views"));
  EXPECT_THAT(message([](auto& h) { h.lights[1].x = 3; }), HasSubstr("light 1"));
  EXPECT_THAT(message([](auto& h) { h.views[1].x = std::nan(""); }), HasSubstr("view 1"));
  EXPECT_THAT(message([](auto& h) { h.views[3] = h.views[1]; }), HasSubstr("views 1 and 3"));
  EXPECT_THAT(message([](auto& h) { h.pitch_mm = -1; }), HasSubstr("pitch"));
  EXPECT_THAT(message([](auto& h) { h.h_ref_mm = std::nan(""); }), HasSubstr("h_ref"));
  EXPECT_THAT(message([](auto& h) { h.mask.resize(3); }), HasSubstr("mask"));
  EXPECT_THAT(message([](auto& h) { h.light_positions_mm.resize(1); }), HasSubstr("positions"));
}

TEST(SampledBtf, StartsAbsent) {
  SampledBtf btf(Header());
  EXPECT_EQ(btf.present_count(), 0u);
  btf.SetPresent(4, 3, true);
  EXPECT_TRUE(btf.Present(4, 3));
  EXPECT_EQ(btf.present_count(), 1u);
  EXPECT_EQ(btf.Image(4, 3).size(), 24u);
}

}  // namespace
}  // namespace mesorig::btf
