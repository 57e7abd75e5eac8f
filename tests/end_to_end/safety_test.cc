// kill -STOP and kill -9 of the daemon in the middle of a capture, by what the rig itself says:
// until when were lamps, laser and torque on? Prints the table of docs/safety.md.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
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
  double now_s = 0;
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
    if (!energy) continue;
    state.on[what] = event == "on";
    state.changed_s[what] = state.now_s;
  }
  return state;
}

bool LampAndTorque(const RigState& state) {
  bool lamp = false, torque = false;
  for (const auto& [what, is] : state.on) {
    lamp |= is && what.starts_with("lamp ");
    torque |= is && what.starts_with("torque ");
  }
  return lamp && torque;
}

// How long after the signal the last of each was on, s; nothing: something stays on, or was never.
struct OffAfter {
  double lamp_rig_s = 0, torque_rig_s = 0, all_host_s = 0;
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
