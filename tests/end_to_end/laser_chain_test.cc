// The laser's part of the chain as separate processes: sweeps, prompts, the gate, the MDF.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <thread>

#include "tests/end_to_end/running_rig.h"

namespace mesorig::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

const std::string kSweeps = "tiny_sweeps.toml";

uintmax_t BytesBelow(const fs::path& folder) {
  uintmax_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) bytes += entry.file_size();
  }
  return bytes;
}

TEST(LaserChain, SweepsBecomeAnMdfAndTheirFramesGo) {
  RunningRig rig(true);
  const json run = rig.RunPlan(kSweeps);
  ASSERT_EQ(run.value("frames_planned", 0), 3 + 4 * 24 * 3) << rig.Logs();
  EXPECT_EQ(run["frames_on_disk"], run["frames_planned"]);
  EXPECT_TRUE(run["deterministic"]);
  std::map<std::string, std::string> products;
  for (const auto& product : run["products"]) products[product["kind"]] = product["path"];
  ASSERT_TRUE(products.contains("btf") && products.contains("mdf")) << run.dump();
  const std::string truth = (rig.folder() / "truth.mdf.exr").string();
  const Outcome made =
      RunProgram("mesorig-sim", {"truth", "--sample", kSource + "/rigs/samples/weave.toml",
                                 "--like", products["mdf"], "--out", truth, "--json"});
  ASSERT_EQ(made.code, 0) << made.text;
  const Outcome compared = RunProgram("mesorig-btf", {"compare", products["mdf"], truth, "--json"});
  ASSERT_EQ(compared.code, 0) << compared.text;
  const json figures = json::parse(compared.text);
  // Pixels of 1.2 mm and two sweeps a view: the demo is held to 0.3 mm and 90 %.
  EXPECT_LE(figures.value("median_abs_mm", 9.0), 0.5) << compared.text;
  EXPECT_GE(figures.value("coverage", 0.0), 0.5) << compared.text;
  // The raw frames of sweeps are gone, their ledger rows are not.
  const fs::path session = rig.folder() / "state" / run["session_id"].get<std::string>();
  for (const auto& entry : fs::recursive_directory_iterator(session / "sweeps")) {
    EXPECT_NE(entry.path().extension(), ".seg") << entry.path();
  }
  EXPECT_LT(BytesBelow(session), run["frame_bytes"].get<uintmax_t>() / 2);
}

// Frames of a complete session, taken again: they supersede, and the products are made anew of them.
TEST(LaserChain, FramesOfACompleteSessionAreTakenAgain) {
  RunningRig rig(true);
  const json run = rig.RunPlan("tiny_night.toml");
  const std::string id = run["session_id"];
  const auto verify = [&] {
    json report = json::parse(rig.Mesorig({"session", "verify", id, "--json"}).text);
    report["session"].erase("age_s");
    return report;
  };
  const json before = verify();
  const fs::path btf = rig.folder() / "products" / id / "sample.btf.exr";
  const auto made = fs::last_write_time(btf);
  const auto digest = [&] { return RunProgram("mesorig-btf", {"digest", btf.string()}).text; };
  const std::string pixels = digest();
  const auto again = [&](const std::string& which) {
    return rig.Mesorig({"resume", id, "--sample", "weave", "--reshoot", which, "--json",
                        "--on-prompt", rig.Operator()});
  };
  const Outcome released = again("sweep 0");
  EXPECT_EQ(released.code, 1) << released.text;
  EXPECT_THAT(released.text, HasSubstr("of a sweep that was released"));
  EXPECT_EQ(verify(), before) << "a refusal leaves it as it was";
  const Outcome reshot = again("shots 2-3, camera cam3");
  ASSERT_EQ(reshot.code, 0) << reshot.text << rig.Logs();
  const json after = verify();
  EXPECT_EQ(after["rows"].get<int>(), before["rows"].get<int>() + 2);
  EXPECT_EQ(after["frames_live"], before["frames_live"]);
  EXPECT_EQ(after["starts"], 2);
  EXPECT_EQ(after["content_digest"], before["content_digest"]) << "without drift, the same pixels";
  EXPECT_NE(fs::last_write_time(btf), made) << rig.Logs();
  EXPECT_EQ(digest(), pixels);
  EXPECT_EQ(rig.Mesorig({"resume", id, "--sample", "weave"}).code, 1) << "it is complete";
}

// By what really happened at the rig: never light while an axis moves, and light in every sweep.
TEST(LaserChain, TheLaserIsOffWhileAxesMove) {
  RunningRig rig(false);
  rig.RunPlan(kSweeps);
  std::istringstream log(rig.RigLog());
  std::string line;
  std::getline(log, line);  // names of the columns
  std::map<std::string, bool> moves;
  bool on = false;
  int sweeps = 0, motions = 0, remounts = 0;
  while (std::getline(log, line)) {
    std::istringstream columns(line);
    std::string time, what, event;
    std::getline(columns, time, '\t');
    std::getline(columns, what, '\t');
    std::getline(columns, event);
    if (what.starts_with("axis ")) {
      moves[what] = event == "moves";
      motions += moves[what];
      EXPECT_FALSE(moves[what] && on) << line;
    }
    if (what == "laser") {
      on = event == "on";
      sweeps += on;
      for (const auto& [axis, moving] : moves) EXPECT_FALSE(on && moving) << axis << ": " << line;
    }
    if (what == "mount") {
      ++remounts;
      EXPECT_FALSE(on) << line;
    }
  }
  EXPECT_FALSE(on);
  EXPECT_EQ(sweeps, 4);
  EXPECT_GE(motions, 4);
  EXPECT_GE(remounts, 2);
}

TEST(LaserChain, SameSeedSameDigests) {
  std::map<std::string, std::string> first;
  for (int i = 0; i < 3; ++i) {
    RunningRig rig(false);
    const auto digests = rig.SegmentDigests(rig.RunPlan(kSweeps).value("session_id", ""));
    ASSERT_EQ(digests.size(), 3u + 4 * 3) << "cameras, and sweeps of each";
    if (i == 0) first = digests;
    EXPECT_EQ(digests, first) << "run " << i;
  }
  RunningRig other(false, "8");
  EXPECT_NE(other.SegmentDigests(other.RunPlan(kSweeps).value("session_id", "")), first);
}

// A prompt that only a console acknowledges waits; stop ends it, dark and complete with a reason.
TEST(LaserChain, APromptNeedsHandsAtTheRig) {
  RunningRig rig(false);
  ASSERT_EQ(rig.Mesorig({"run", kTiny + kSweeps, "--no-wait"}).code, 0);
  json status;
  for (int i = 0; i < 600 && !status.contains("prompt"); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));  // host time: the operator's
    status = json::parse(rig.Mesorig({"status", "--json"}).text, nullptr, false);
  }
  ASSERT_TRUE(status.contains("prompt")) << rig.Logs();
  EXPECT_EQ(status["state"], "WAITING");
  EXPECT_EQ(status["prompt"]["mount"], "zenith");
  EXPECT_EQ(rig.Mesorig({"acknowledge"}).code, 0);
  const Outcome text = rig.Mesorig({"status"});
  EXPECT_THAT(text.text, HasSubstr("needs     the door opened and closed, reset pressed"));
  const Outcome nowhere = rig.Inject({"operator", "remount", "attic"});
  EXPECT_EQ(nowhere.code, 2);
  EXPECT_THAT(nowhere.text, HasSubstr("attic"));
  EXPECT_EQ(rig.Mesorig({"stop"}).code, 0);
  EXPECT_EQ(rig.Mesorig({"acknowledge"}).code, 1) << "nothing is asked any more";
}

}  // namespace
}  // namespace mesorig::test
