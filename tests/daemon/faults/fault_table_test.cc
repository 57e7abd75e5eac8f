// A small session under each fault, at several moments, alone and in random pairs: it ends right,
// or in a fault that names the device; in either case nothing that was acknowledged is lost, every
// frame that is there is the one that a run without faults takes, and lamps and torque are off.
// Prints the table.

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <random>

#include "tests/daemon/faults/fault_bench.h"

namespace mesorig::daemon {
namespace {

struct Fault {
  std::vector<std::pair<double, std::string>> injections;  // seconds after its moment
  std::vector<std::string> names;  // one of them is in the message of a run that ends in a fault
};

Fault OfAxis(const std::string& axis, const std::string& text) {
  return {{{0, "can " + axis + " " + text}}, {"axis " + axis}};
}
Fault OfLamps(const std::string& text) { return {{{0, "lamps " + text}}, {"lamp"}}; }
Fault OfCamera(const std::string& text) { return {{{0, "camera:1000 " + text}}, {"camera C0"}}; }
Fault Then(Fault fault, double seconds, const std::string& text) {
  fault.injections.emplace_back(seconds, text);
  return fault;
}

std::vector<Fault> AllKinds() {
  return {
      OfAxis("turntable", "drop 2"),
      OfAxis("turntable", "drop 2 in"),
      OfAxis("arc", "delay 200 3"),
      OfAxis("arc", "corrupt 2"),
      OfAxis("turntable", "duplicate 4"),
      OfAxis("arc", "disconnect"),
      Then(OfAxis("arc", "disconnect"), 1, "can arc replug"),
      OfAxis("turntable", "stuck"),
      Then(OfAxis("turntable", "stuck"), 2, "can turntable free"),
      OfAxis("arc", "lose 2"),
      OfAxis("turntable", "lose -0.5"),
      {{{0, "can disconnect"}, {1.5, "can replug"}}, {"axis"}},
      OfLamps("drop 2"),
      OfLamps("delay 300"),
      OfLamps("corrupt 3"),
      OfLamps("duplicate 2"),
      OfLamps("exception 2"),
      OfLamps("close"),
      OfLamps("disconnect"),
      Then(OfLamps("disconnect"), 1, "lamps replug"),
      OfLamps("dead L0"),
      Then(OfLamps("dead L1"), 4, "lamps alive L1"),
      {{{0, "lines drop"}}, {"interlock chain"}},
      {{{0, "lines disconnect"}}, {"interlock chain"}},
      {{{0, "lines stuck door"}}, {"interlock chain"}},
      {{{0, "lines stuck door"}, {0.1, "lines door open"}}, {"axis", "lamp", "interlock"}},
      {{{0, "lines door open"}}, {"interlock chain: door"}},
      {{{0, "lines estop open"}, {0.2, "lines estop close"}}, {"interlock chain: emergency stop"}},
      OfCamera("drop"),
      OfCamera("drop 2 in"),
      OfCamera("delay 700 2"),
      OfCamera("delay 100 in"),
      OfCamera("corrupt 2"),
      OfCamera("duplicate 2"),
      OfCamera("disconnect"),
      Then(OfCamera("disconnect"), 1.5, "camera:1000 replug"),
      OfCamera("silent"),
      OfCamera("silent 2"),
      Then(OfCamera("silent"), 3, "camera:1000 disconnect"),
      OfCamera("torn 2"),
      OfCamera("stale"),
      OfCamera("wrong_id 2"),
      OfCamera("clock -3"),
      OfCamera("clock 1.5"),
      {{{0, "camera:1001 drop 2"}}, {"camera C1"}},
      {{{0, "camera:1001 disconnect"}, {2, "camera:1001 replug"}}, {"camera C1"}},
      {{{0, "rig leap 2"}}, {"axis", "lamp", "camera"}},
  };
}

// During sweeps: of the laser, its gate and what else takes part in them.
std::vector<Fault> KindsOfSweeps() {
  const auto of_laser = [](const std::string& text) {
    return Fault{{{0, "nxt " + text}}, {"line_laser", "laser"}};
  };
  return {
      of_laser("drop"),
      of_laser("drop 2 in"),
      of_laser("delay 300 2"),
      of_laser("delay 1500"),
      of_laser("corrupt 2"),
      of_laser("corrupt in"),
      of_laser("duplicate 3"),
      of_laser("disconnect"),
      Then(of_laser("disconnect"), 2, "nxt replug"),
      of_laser("stuck"),
      Then(of_laser("stuck"), 1.5, "nxt free"),
      of_laser("switch off"),
      Then(of_laser("switch off"), 2, "nxt switch on"),
      {{{0, "lines stuck laser_on"}}, {"laser"}},
      {{{0, "lines door open"}}, {"interlock chain: door"}},
      {{{0, "lines drop"}}, {"interlock chain", "laser"}},
      OfCamera("drop"),
      OfCamera("torn"),
      Then(OfCamera("disconnect"), 1.5, "camera:1000 replug"),
      OfAxis("arc", "lose 2"),
      {{{0, "rig leap 2"}}, {"axis", "laser", "camera"}},
  };
}

std::string Text(const Fault& fault) {
  std::string text;
  for (const auto& [seconds, injection] : fault.injections) {
    text += fmt::format("{}{}", text.empty() ? "" : fmt::format("; {:g} s: ", seconds), injection);
  }
  return text;
}

class FaultTable : public ::testing::Test {
 protected:
  void SetUp() override {
    root_ = std::filesystem::temp_directory_path() / fmt::format("mesorig-faults-{}", ::getpid());
    std::filesystem::remove_all(root_);
    std::filesystem::create_directories(root_);
    RunPlain(FaultedPlan::kLamps, 5);
  }
  void RunPlain(FaultedPlan plan, size_t frames) {
    plan_ = plan;
    plain_ = RunUnderFaults(root_, {}, plan);
    ASSERT_TRUE(plain_.complete) << plain_.reason;
    ASSERT_EQ(plain_.live.size(), frames);
    ASSERT_EQ(plain_.recoveries, 0);
  }
  void TearDown() override { std::filesystem::remove_all(root_); }

  void Check(const std::vector<std::pair<double, Fault>>& faults) {
    FaultScript script;
    std::vector<std::string> names;
    std::string text;
    for (const auto& [moment_s, fault] : faults) {
      for (const auto& [seconds, injection] : fault.injections) {
        script.push_back({FromSeconds(moment_s + seconds), injection});
      }
      names.insert(names.end(), fault.names.begin(), fault.names.end());
      text += fmt::format("{}{:5.2f} s {}", text.empty() ? "" : " + ", moment_s, Text(fault));
    }
    std::stable_sort(script.begin(), script.end(),
                     [](const auto& a, const auto& b) { return a.at < b.at; });
    SCOPED_TRACE(text);
    const FaultOutcome outcome = RunUnderFaults(root_, script, plan_);
    fmt::print("| {:<72} | {} | {} | {}\n", text, outcome.complete ? "right" : "fault",
               outcome.recoveries, outcome.complete ? "" : outcome.reason);
    ++ended_[outcome.complete ? 0 : 1];
    recoveries_ += outcome.recoveries;
    EXPECT_EQ(outcome.damage, "");
    EXPECT_EQ(outcome.still_on, "");
    if (outcome.complete) {
      EXPECT_EQ(outcome.live, plain_.live);
      return;
    }
    for (const auto& [frame, digest] : outcome.live) {
      EXPECT_EQ(digest, plain_.live[frame])
          << "camera " << frame.first << ", shot " << frame.second;
    }
    const bool named = std::any_of(names.begin(), names.end(), [&](const std::string& name) {
      return outcome.reason.find(name) != std::string::npos;
    });
    EXPECT_TRUE(named) << outcome.reason;
  }

  // At each share of the session's duration.
  void CheckAlone(const std::vector<Fault>& kinds, const std::vector<double>& shares) {
    for (const Fault& fault : kinds) {
      for (const double share : shares) Check({{share * plain_.virtual_s, fault}});
    }
    fmt::print("{} ended right, {} in a fault, {} recoveries\n", ended_[0], ended_[1], recoveries_);
  }

  std::filesystem::path root_;
  FaultedPlan plan_ = FaultedPlan::kLamps;
  FaultOutcome plain_;
  int ended_[2] = {0, 0};
  int recoveries_ = 0;
};

TEST_F(FaultTable, EachAlone) {
  // While it homes; on the way to the first shot; among the shots.
  CheckAlone(AllKinds(), {0.2, 0.62, 0.78});
  EXPECT_GT(ended_[0], 3 * static_cast<int>(AllKinds().size()) / 2) << "most are overcome";
}

TEST_F(FaultTable, InSweepsOfTheLaser) {
  ASSERT_NO_FATAL_FAILURE(RunPlain(FaultedPlan::kSweeps, 32));
  const std::vector<Fault> kinds = KindsOfSweeps();
  // On the emitter's way to a sweep; in sweeps of both mounts.
  CheckAlone(kinds, {0.5, 0.66, 0.93});
  EXPECT_GT(ended_[0], 3 * static_cast<int>(kinds.size()) / 2) << "half of them and more are overcome";
}

TEST_F(FaultTable, RandomPairs) {
  std::mt19937 random(20240611);
  const std::vector<Fault> kinds = AllKinds();
  const auto moment = [&] {
    return plain_.virtual_s * static_cast<double>(random() % 1000) / 1000;
  };
  for (int pair = 0; pair < 60; ++pair) {
    const double first_s = moment(), second_s = moment();
    const Fault& first = kinds[random() % kinds.size()];
    const Fault& second = kinds[random() % kinds.size()];
    Check({{first_s, first}, {second_s, second}});
  }
  fmt::print("{} ended right, {} in a fault, {} recoveries\n", ended_[0], ended_[1], recoveries_);
  EXPECT_GT(ended_[0], 10);
}

}  // namespace
}  // namespace mesorig::daemon
