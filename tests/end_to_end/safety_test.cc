// kill -STOP and kill -9 of the daemon in the middle of a capture, and while the laser shines beside a
// lamp and torque, by what the rig itself says: until when was each on? Prints the table of
// docs/safety.md.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <functional>
#include <map>
#include <optional>
#include <sstream>

#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {
namespace {

// The rig's log: when each thing last went off, and what is on still.
struct RigState {
  std::map<std::string, double> changed_s;
  std::map<std::string, bool> on;
  double now_s = 0, injected_s = 0;  // of the last line, and of the last that says "injected"
  bool AnythingOn() const {
    for (const auto& [what, is] : on) {
      if (is) return true;
    }
    return false;
  }
};

RigState ReadRig(const RunningRig& rig) {
  RigState state;
  std::istringstream lines(ReadFile(rig.folder() / "rig.tsv").value_or(""));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::istringstream fields(line);
    std::string time, what, event;
    std::getline(fields, time, '\t');
    std::getline(fields, what, '\t');
    std::getline(fields, event, '\t');
    const bool energy = what == "laser" || what.starts_with("lamp ") || what.starts_with("torque ");
    state.now_s = std::stod(time);
    if (what == "injected" || event == "injected") state.injected_s = state.now_s;
    if (!energy) continue;
    state.on[what] = event == "on";
    state.changed_s[what] = state.now_s;
  }
  return state;
}

bool IsOn(const RigState& state, std::string_view kind) {
  return std::any_of(state.on.begin(), state.on.end(),
                     [&](const auto& each) { return each.second && each.first.starts_with(kind); });
}

bool LampAndTorque(const RigState& state) {
  return IsOn(state, "lamp ") && IsOn(state, "torque ");
}

// The rig's own log, until `what` holds or for 20 s of host time.
bool AwaitRig(const RunningRig& rig, const std::function<bool(const RigState&)>& what) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (!what(ReadRig(rig))) {
    if (std::chrono::steady_clock::now() > end) return false;
    PollPause();
  }
  return true;
}

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

// By hand, at the pace of the wall clock: an axis with torque, a lamp and the laser, all at once.
// What is injected just before the signal changes nothing and leaves the rig's time in its log.
std::optional<OffAfter> MeasureLaser(int signal, const char* name) {
  RunningRig rig(false);
  const auto log = rig.folder() / "lease.log";
  const Service lease("mesorig", {"lease", "take", "--runtime-dir", rig.folder().path().string()},
                      log);
  if (!AwaitRig(rig, [&](const RigState&) {
        return lease.Log().find("yours until") != std::string::npos;
      })) {
    ADD_FAILURE() << lease.Log();
    return std::nullopt;
  }
  const std::string token = std::to_string(std::stoull(lease.Log().substr(6)));
  for (std::vector<std::string> words :
       {std::vector<std::string>{"axis", "turntable", "--home"}, {"lamp", "lamp0"}}) {
    words.insert(words.end(), {"--lease", token});
    const Outcome done = rig.Mesorig(words);
    EXPECT_EQ(done.code, 0) << done.text;
  }
  const Service laser("mesorig",
                      {"laser", "--for", "10", "--lease", token, "--runtime-dir",
                       rig.folder().path().string()},
                      rig.folder() / "laser.log");
  if (!AwaitRig(rig, [](const RigState& state) {
        return LampAndTorque(state) && IsOn(state, "laser");
      })) {
    ADD_FAILURE() << laser.Log();
    return std::nullopt;
  }
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
