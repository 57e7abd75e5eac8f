// The laser unit's gate and mount, and the lines that trigger it.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "simulator/devices/digital_lines/digital_lines.h"
#include "simulator/devices/laser_unit/laser_unit.h"

namespace mesorig::simulator {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::HasSubstr;

Rig Demo() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

class LaserTest : public ::testing::Test {
 protected:
  void SetTrigger(int level, RigTime at) {
    const auto line = static_cast<uint16_t>(rig_.lines.laser_trigger);
    lines_.Command(at, sim_wire::Pack(sim_wire::LineEdge{line, static_cast<uint8_t>(level)}), out_);
  }
  void Edge(RigTime at) {
    SetTrigger(0, at);
    SetTrigger(1, at);
  }
  int LaserOn(RigTime at) {
    const auto line = static_cast<uint16_t>(rig_.lines.laser_on);
    return lines_.Query(at, sim_wire::PackLineQuery(line), out_).value()[0];
  }
  // Levels of the edges of laser_on that were said.
  std::vector<int> Edges() {
    std::vector<int> levels;
    for (const std::string& said : out_.Take()) {
      const auto edge = sim_wire::UnpackLineEdge(said).value();
      if (edge.line == rig_.lines.laser_on) levels.push_back(edge.level);
    }
    return levels;
  }
  void RunUntil(RigTime t) {
    while (lines_.NextEvent() <= t) lines_.RunEvent(lines_.NextEvent(), out_);
  }

  const Rig rig_ = Demo();
  Contactor contactor_;
  LaserUnit unit_{rig_, 5, contactor_};
  DigitalLinesDevice lines_{rig_.lines, contactor_, &unit_};
  sim_wire::Outbox out_;
};

TEST_F(LaserTest, OneShotHoldsAQuarterOfASecond) {
  EXPECT_EQ(LaserOn({}), 0);
  Edge(seconds(1));
  EXPECT_EQ(Edges(), (std::vector{1}));
  EXPECT_EQ(LaserOn(milliseconds(1249)), 1);
  EXPECT_EQ(lines_.NextEvent(), RigTime(milliseconds(1250)));
  RunUntil(milliseconds(1250));
  EXPECT_EQ(Edges(), (std::vector{0}));
  EXPECT_EQ(LaserOn(milliseconds(1250)), 0);
  EXPECT_EQ(lines_.NextEvent(), kNever);
}

TEST_F(LaserTest, EdgesRetriggerAndASteadyLevelIsOff) {
  for (int i = 0; i < 20; ++i) {
    RunUntil(milliseconds(100 * i));
    Edge(milliseconds(100 * i));
  }
  EXPECT_EQ(Edges(), (std::vector{1})) << "on all the time";
  SetTrigger(1, milliseconds(2000));  // no edge: it is high already
  RunUntil(milliseconds(2150));
  EXPECT_EQ(Edges(), (std::vector{0}));
  SetTrigger(1, milliseconds(2200));
  EXPECT_EQ(LaserOn(milliseconds(2200)), 0);
}

TEST_F(LaserTest, ContactorCutsItAndClosingDoesNotBringItBack) {
  Edge(seconds(1));
  ASSERT_TRUE(lines_.Inject(milliseconds(1100), "door open", out_).ok());
  EXPECT_EQ(LaserOn(milliseconds(1100)), 0);
  EXPECT_EQ(Edges(), (std::vector{1, 0}));
  Edge(milliseconds(1110));
  EXPECT_EQ(LaserOn(milliseconds(1110)), 0) << "no supply";
  ASSERT_TRUE(lines_.Inject(milliseconds(1120), "door close", out_).ok());
  ASSERT_TRUE(lines_.Inject(milliseconds(1130), "reset", out_).ok());
  ASSERT_TRUE(contactor_.closed());
  EXPECT_EQ(LaserOn(milliseconds(1130)), 0) << "the one-shot does not outlive its supply";
  Edge(milliseconds(1140));
  EXPECT_EQ(LaserOn(milliseconds(1140)), 1);
}

TEST_F(LaserTest, BrickTakesTheSupplyWithIt) {
  Edge(seconds(1));
  (void)out_.Take();
  unit_.SetBrickOn(false, milliseconds(1100));
  EXPECT_EQ(lines_.NextEvent(), RigTime(milliseconds(1100)));
  RunUntil(milliseconds(1100));
  EXPECT_EQ(Edges(), (std::vector{0}));
  EXPECT_EQ(lines_.NextEvent(), kNever);
}

TEST_F(LaserTest, MeanLevelOverAnExposure) {
  Edge(seconds(1));
  RunUntil(seconds(2));
  EXPECT_EQ(unit_.MeanLevel(milliseconds(1010), milliseconds(1030)), 1);
  EXPECT_NEAR(unit_.MeanLevel(milliseconds(990), milliseconds(1010)), 0.5, 1e-12);
  EXPECT_NEAR(unit_.MeanLevel(milliseconds(1240), milliseconds(1280)), 0.25, 1e-12);
  EXPECT_EQ(unit_.MeanLevel(milliseconds(1500), milliseconds(1600)), 0);
  EXPECT_EQ(unit_.MeanLevel({}, milliseconds(100)), 0);
}

TEST_F(LaserTest, OtherCommandsChangeNothing) {
  lines_.Command({}, "junk", out_);
  lines_.Command({}, sim_wire::Pack(sim_wire::LineEdge{0, 1}), out_);
  EXPECT_TRUE(out_.Take().empty());
  EXPECT_EQ(LaserOn({}), 0);
}

TEST_F(LaserTest, MountsWhileTheDoorIsOpen) {
  EXPECT_EQ(unit_.mount(), 0);
  EXPECT_EQ(unit_.Mount("slant", seconds(1)).code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_TRUE(lines_.Inject(seconds(1), "door open", out_).ok());
  const Status unknown = unit_.Mount("ceiling", seconds(1));
  EXPECT_EQ(unknown.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(unknown.message()), HasSubstr("zenith, slant"));
  ASSERT_TRUE(unit_.Mount("slant", seconds(1)).ok());
  EXPECT_EQ(unit_.mount(), 1);
}

// Each mount has its own misset, of seed and mount alone: the same after every remount.
TEST_F(LaserTest, MissetIsSmallAndTheSameAgain) {
  const double first = unit_.Tilt({});
  EXPECT_NE(first, 0);
  EXPECT_LT(std::abs(first), LaserUnit::kMisset_rad);
  ASSERT_TRUE(lines_.Inject(seconds(1), "door open", out_).ok());
  unit_.motor().Drive(3, 0.05, seconds(1));
  ASSERT_TRUE(unit_.Mount("slant", seconds(4)).ok());
  EXPECT_LT(std::abs(unit_.Tilt(seconds(4))), LaserUnit::kMisset_rad);
  EXPECT_NE(unit_.Tilt(seconds(4)), first);
  ASSERT_TRUE(unit_.Mount("zenith", seconds(5)).ok());
  EXPECT_NEAR(unit_.Tilt(seconds(5)), first, 1e-12);
  Contactor other;
  EXPECT_NE(LaserUnit(rig_, 6, other).Tilt({}), first) << "another seed";
}

}  // namespace
}  // namespace mesorig::simulator
