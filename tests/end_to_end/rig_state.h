#pragma once
// What really happens at a running rig, by the simulator's log of it.

#include <algorithm>
#include <chrono>
#include <functional>
#include <map>
#include <sstream>
#include <string>

#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {

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

inline RigState ReadRig(const RunningRig& rig) {
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

inline bool IsOn(const RigState& state, std::string_view kind) {
  return std::any_of(state.on.begin(), state.on.end(),
                     [&](const auto& each) { return each.second && each.first.starts_with(kind); });
}

inline bool LampAndTorque(const RigState& state) {
  return IsOn(state, "lamp ") && IsOn(state, "torque ");
}

// The rig's own log, until `what` holds or for a minute of host time.
inline bool AwaitRig(const RunningRig& rig, const std::function<bool(const RigState&)>& what) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!what(ReadRig(rig))) {
    if (std::chrono::steady_clock::now() > end) return false;
    PollPause();
  }
  return true;
}

// By hand, at the pace of the wall clock: an axis with torque, a lamp and the laser, all at once, for
// ten seconds. Borrows the rig.
class EverythingOnByHand {
 public:
  explicit EverythingOnByHand(const RunningRig& rig)
      : lease_("mesorig", {"lease", "take", "--runtime-dir", rig.folder().path().string()},
               rig.folder() / "lease.log") {
    const auto leased = [&](const RigState&) {
      return lease_.Log().find("yours until") != std::string::npos;
    };
    EXPECT_TRUE(AwaitRig(rig, leased)) << lease_.Log();
    if (!leased({})) return;
    const std::string token = std::to_string(std::stoull(lease_.Log().substr(6)));
    for (std::vector<std::string> words :
         {std::vector<std::string>{"axis", "turntable", "--home"}, {"lamp", "lamp0"}}) {
      words.insert(words.end(), {"--lease", token});
      const Outcome done = rig.Mesorig(words);
      EXPECT_EQ(done.code, 0) << done.text;
    }
    laser_ = std::make_unique<Service>(
        "mesorig",
        std::vector<std::string>{"laser", "--for", "10", "--lease", token, "--runtime-dir",
                                 rig.folder().path().string()},
        rig.folder() / "laser.log");
    on_ = AwaitRig(
        rig, [](const RigState& state) { return LampAndTorque(state) && IsOn(state, "laser"); });
    EXPECT_TRUE(on_) << laser_->Log() << rig.Logs();
  }
  bool on() const { return on_; }

 private:
  const Service lease_;
  std::unique_ptr<Service> laser_;
  bool on_ = false;
};

}  // namespace mesorig::test
