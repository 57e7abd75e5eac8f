// A capture whose lamps are on a serial line of this machine (Modbus RTU at a pseudo-terminal), in the
// system's time. The guest of tests/hil has the other buses.

#include <gmock/gmock.h>

#include "tests/hil/real_rig.h"

namespace mesorig::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::set<std::string> kBuses = {"modbus"};

TEST(RealBus, CapturesOverASerialLineAsOverTheSimulatorsWire) {
  const RigFiles files(kBuses);
  const RealRig rig(files, kBuses);
  const auto run = rig.RunPlan(files.plan());
  EXPECT_EQ(run.value("complete", false), true) << rig.AllLogs();
  EXPECT_EQ(run.value("deterministic", true), false) << "the clock is the system's";
  ExpectSame(FramesOf(rig, run.value("session_id", "")), LocalFrames());
}

TEST(RealBus, ALineThatIsPulledOutAndPutInAgain) {
  const RigFiles files(kBuses);
  RealRig rig(files, kBuses, "modbus");
  const auto run = rig.BeginPlan();
  ASSERT_TRUE(AwaitRig(rig, LampAndTorque)) << run->Log() << rig.AllLogs();
  rig.Unplug();
  EXPECT_TRUE(AwaitRig(rig, [](const RigState& state) { return !IsOn(state, "lamp "); }))
      << "the bank's timeout";
  rig.PlugIn("modbus");
  ASSERT_NO_FATAL_FAILURE(ExpectWholeInTheEnd(rig, *run, LocalFrames()));
}

TEST(RealBus, WhatCannotBeSaysSo) {
  const RigFiles files(kBuses);
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& rig) {
    return RunProgram("mesorigd", {"--rig", rig, "--state-dir", (folder / "state").string(),
                                   "--runtime-dir", folder.path().string()});
  };
  const Outcome no_cameras = refused((files.folder / "real.toml").string());
  EXPECT_NE(no_cameras.code, 0);
  EXPECT_THAT(no_cameras.text, AllOf(HasSubstr("cameras"), HasSubstr("mesorig-sim run")));
  // With the simulator, and another daemon that has the line.
  RealRig rig(files, kBuses);
  std::filesystem::copy(rig.folder() / "mesorig-sim.endpoint", folder / "mesorig-sim.endpoint");
  const Outcome second = refused((files.folder / "real.toml").string());
  EXPECT_NE(second.code, 0);
  EXPECT_THAT(second.text, HasSubstr(fmt::format("in use by process {}", rig.daemon().pid())));
}

}  // namespace
}  // namespace mesorig::test
