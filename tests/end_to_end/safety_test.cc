// kill -STOP and kill -9 of the daemon in the middle of a capture, and while the laser shines beside a
// lamp and torque, by what the rig itself says: until when was each on? Prints the table of
// docs/safety.md.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <optional>

#include "tests/end_to_end/rig_state.h"

namespace mesorig::test {
namespace {

// How long after the signal the last of each was on, s; nothing: something stays on, or was never.
struct OffAfter {
  double laser_rig_s = 0, lamp_rig_s = 0, torque_rig_s = 0, all_host_s = 0;
};

std::optional<OffAfter> Measure(int signal, const char* name) {
  RunningRig rig(false);
  EXPECT_EQ(rig.Mesorig({"run", kTiny + "tiny_night.toml", "--no-wait"}).code, 0) << rig.Logs();
  for (int i = 0; i < 4000 && !LampAndTorque(ReadRig(rig)); ++i) PollPause();
  if (!LampAndTorque(ReadRig(rig))) return std::nullopt;
  EXPECT_EQ(::kill(rig.daemon().pid(), signal), 0);
  const auto since = std::chrono::steady_clock::now();
  // What was on when the daemon was silenced: the last thing that it did is in the log now.
  ::usleep(300'000);
  const RigState at = ReadRig(rig);
  for (int i = 0; i < 4000 && ReadRig(rig).AnythingOn(); ++i) PollPause();
  OffAfter off;
  off.all_host_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
  const RigState after = ReadRig(rig);
  if (signal == SIGSTOP) ::kill(rig.daemon().pid(), SIGKILL);
  if (after.AnythingOn()) return std::nullopt;
  for (const auto& [what, when] : after.changed_s) {
    double& latest = what.starts_with("torque") ? off.torque_rig_s : off.lamp_rig_s;
    latest = std::max(latest, when - at.now_s);
  }
  std::printf("| signal | lamps off (rig time) | torque off (rig time) | all off (host time) |\n");
  std::printf("| %s | %.2f s | %.2f s | %.2f s |\n", name, off.lamp_rig_s, off.torque_rig_s,
              off.all_host_s);
  return off;
}

TEST(Safety, KilledDaemon) {
  const auto off = Measure(SIGKILL, "kill -9");
  ASSERT_TRUE(off.has_value());
  EXPECT_LE(off->lamp_rig_s, 1.5) << "the bank's timeout";
  EXPECT_LE(off->torque_rig_s, 3) << "the drives' heartbeat and the quick stop";
}

TEST(Safety, StoppedDaemon) {
  const auto off = Measure(SIGSTOP, "kill -STOP");
  ASSERT_TRUE(off.has_value());
  EXPECT_LE(off->lamp_rig_s, 1.5) << "the bank's timeout";
  EXPECT_LE(off->torque_rig_s, 3) << "the drives' heartbeat and the quick stop";
}

// What is injected just before the signal changes nothing and leaves the rig's time in its log.
std::optional<OffAfter> MeasureLaser(int signal, const char* name) {
  RunningRig rig(false);
  const EverythingOnByHand everything(rig);
  if (!everything.on()) return std::nullopt;
  EXPECT_EQ(rig.Inject({"can", "turntable", "free"}).code, 0);
  EXPECT_EQ(::kill(rig.daemon().pid(), signal), 0);
  const auto since = std::chrono::steady_clock::now();
  const bool off = AwaitRig(rig, [](const RigState& state) { return !state.AnythingOn(); });
  OffAfter after;
  after.all_host_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
  if (signal == SIGSTOP) ::kill(rig.daemon().pid(), SIGKILL);
  if (!off) return std::nullopt;
  const RigState state = ReadRig(rig);
  for (const auto& [what, when] : state.changed_s) {
    double& latest = what.starts_with("torque") ? after.torque_rig_s
                     : what == "laser"          ? after.laser_rig_s
                                                : after.lamp_rig_s;
    latest = std::max(latest, when - state.injected_s);
  }
  std::printf("| signal | laser off (rig) | lamps off (rig) | torque off (rig) | all off (host) |\n");
  std::printf("| %s | %.2f s | %.2f s | %.2f s | %.2f s |\n", name, after.laser_rig_s,
              after.lamp_rig_s, after.torque_rig_s, after.all_host_s);
  return after;
}

// (The bounds leave room for the time from the injection to the signal.)
TEST(Safety, KilledDaemonWhileTheLaserShines) {
  const auto off = MeasureLaser(SIGKILL, "kill -9, laser");
  ASSERT_TRUE(off.has_value());
  EXPECT_LE(off->laser_rig_s, 1) << "the one-shot";
  EXPECT_LE(off->lamp_rig_s, 2) << "the bank's timeout";
  EXPECT_LE(off->torque_rig_s, 3) << "the drives' heartbeat";
}

TEST(Safety, StoppedDaemonWhileTheLaserShines) {
  const auto off = MeasureLaser(SIGSTOP, "kill -STOP, laser");
  ASSERT_TRUE(off.has_value());
  EXPECT_LE(off->laser_rig_s, 1) << "the one-shot";
  EXPECT_LE(off->lamp_rig_s, 2) << "the bank's timeout";
  EXPECT_LE(off->torque_rig_s, 3) << "the drives' heartbeat";
}

// The rig that was just switched on: a person presses reset, then it runs.
TEST(Safety, EmergencyStopNeedsAResetAtTheRig) {
  RunningRig rig(false);
  ASSERT_EQ(rig.Inject({"lines", "estop", "open"}).code, 0);
  ASSERT_EQ(rig.Inject({"lines", "estop", "close"}).code, 0);
  const Outcome refused = rig.Mesorig({"run", kTiny + "tiny_plan.toml"});
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.text, ::testing::HasSubstr("press reset (line 2) at the rig"));
  ASSERT_EQ(rig.Inject({"lines", "reset"}).code, 0);
  EXPECT_EQ(rig.RunPlan().value("complete", false), true);
}

}  // namespace
}  // namespace mesorig::test
