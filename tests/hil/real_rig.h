#pragma once
// The tiny rig with axes, lamps and lines on the kernel's interfaces, as processes: `mesorigd` with the
// buses of its rig file, `mesorig-sim run`, and a bridge for each bus.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/file_writer.h"
#include "tests/end_to_end/rig_state.h"
#include "tests/hil/shell.h"

namespace mesorig::test {

// A file of tests/end_to_end or rigs with some of its lines changed.
inline std::string Changed(const std::string& file,
                           const std::vector<std::pair<std::string, std::string>>& changes) {
  std::string text = ReadFile(kSource + file).value();
  for (const auto& [key, line] : changes) {
    text = std::regex_replace(text, std::regex("\n" + key + " = [^\n]*"), "\n" + line);
  }
  return text;
}

// The tiny rig with faster axes, and with cameras that may begin late and watches that have patience:
// what is simulated lives beside the real buses, in an emulated machine. Its plan and sample are smaller for the same reason.
struct RigFiles {
  // buses: those of "can", "gpio", "modbus", "usb" that real.toml names.
  explicit RigFiles(const std::set<std::string>& buses) {
    const std::string rig = Changed("/tests/end_to_end/tiny_rig.toml",
                                    {{"homing_velocity_deg_s", "homing_velocity_deg_s = 90"},
                                     {"max_velocity_deg_s", "max_velocity_deg_s = 180"},
                                     {"acceleration_deg_s2", "acceleration_deg_s2 = 720"},
                                     {"timeout_s", "timeout_s = 3"},
                                     {"heartbeat_s", "heartbeat_s = 1"},
                                     {"readout_s", "readout_s = 0.05\ntrigger_latency_s = 0.2"}});
    const std::map<std::string, std::string> named = {
        {"can", "[buses.can]\ninterface = \"vcan0\"\n"},
        {"gpio", "[buses.gpio]\nchip = \"rig-lines\"\n[buses.gpio.names]\nestop = \"E-STOP\"\n"
                 "laser_trigger = \"LASER-GATE\"\n"},
        {"modbus", "[buses.modbus]\nrtu = \"" + tty() + "\"\n"},
        {"usb", "[buses.usb]\nserial = \"0016530A1B2C\"\n"}};
    std::string real = rig;
    for (const std::string& bus : buses) real += named.at(bus);
    Write("local.toml", rig);
    Write("real.toml", real);
    Write("plan.toml", R"(
name = "small"
[sample]
name = "weave"
[product]
width_px = 16
height_px = 16
pitch_mm = 1.5
h_ref_mm = 4.2
[[grid]]
exposure_s = 0.02
[grid.axes.turntable]
angles_deg = [90]
[grid.axes.light_arc]
angles_deg = [90, 150]
)");
    Write("weave.toml", Changed("/rigs/samples/weave.toml", {{"grid_mm", "grid_mm = 0.5"}}));
  }
  void Write(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name) << text;
  }
  RunningRigOptions Options(const std::string& rig) const {
    return {.rig = (folder / rig).string(),
            .sample = (folder / "weave.toml").string(),
            .samples_per_side = 1};
  }
  std::string plan() const { return (folder / "plan.toml").string(); }
  std::string tty() const { return (folder / "tty-lamps").string(); }
  TemporaryFolder folder;
};
constexpr size_t kFrames = 18;  // of the plan: two stations, three lamps, three cameras

class RealRig : public RunningRig {
 public:
  // apart: the bus whose bridge is a process of its own.
  RealRig(const RigFiles& files, const std::set<std::string>& buses, const std::string& apart = "")
      : RunningRig(WithoutDaemon(files.Options("real.toml"))), files_(files) {
    std::set<std::string> together = buses;
    together.erase(apart);
    if (!together.empty()) bridge_ = StartBridge(together);
    if (!apart.empty()) apart_ = StartBridge({apart});
    if (buses.contains("usb")) hil::Shell("usbip attach -r 127.0.0.1 -b 1-1");
    StartDaemon();
  }
  std::unique_ptr<Service> StartBridge(const std::set<std::string>& buses) const {
    static int count = 0;
    std::vector<std::string> words = {"bridge", "--runtime-dir", folder().path().string()};
    const std::map<std::string, std::string> where = {
        {"can", "vcan0"}, {"gpio", "rig-lines"}, {"modbus", files_.tty()}, {"usb", "3240"}};
    for (const std::string& bus : buses) words.insert(words.end(), {"--" + bus, where.at(bus)});
    if (buses.contains("gpio") || buses.contains("usb")) {
      words.insert(words.end(), {"--rig", (files_.folder / "real.toml").string()});
    }
    auto bridge = std::make_unique<Service>(
        "mesorig-sim", words, folder() / fmt::format("bridge{}.log", count++));
    EXPECT_TRUE(hil::Eventually([&] {
      return bridge->Log().find("all bridges stand") != std::string::npos;
    })) << bridge->Log();
    return bridge;
  }
  // The one apart goes, as a plug that is pulled, and comes back.
  void Unplug() { apart_->End(SIGKILL); }
  void PlugIn(const std::string& bus) { apart_ = StartBridge({bus}); }
  // A run that goes on while something happens to it.
  std::unique_ptr<Service> BeginPlan() const {
    return std::make_unique<Service>(
        "mesorig",
        std::vector<std::string>{"run", files_.plan(), "--json", "--no-products", "--runtime-dir",
                                 folder().path().string()},
        folder() / "run.log");
  }
  std::string AllLogs() const {
    std::string logs = Logs();
    for (const auto* bridge : {bridge_.get(), apart_.get()}) {
      if (bridge != nullptr) logs += bridge->Log();
    }
    return logs;
  }
  // The newest session's id; empty: none.
  std::string LastSession() const {
    std::string last;
    for (const auto& entry : std::filesystem::directory_iterator(folder() / "state")) {
      if (std::filesystem::exists(entry.path() / "plan.bin")) {
        last = std::max(last, entry.path().filename().string());
      }
    }
    return last;
  }

 private:
  static RunningRigOptions WithoutDaemon(RunningRigOptions options) {
    options.daemon = false;
    return options;
  }
  const RigFiles& files_;
  std::unique_ptr<Service> bridge_, apart_;
};

// Pixels of a session's frames, by shot and camera; prints what its journal says besides.
using Frames = std::map<std::pair<uint32_t, int>, std::string>;
inline Frames FramesOf(const RunningRig& rig, const std::string& session) {
  Frames frames;
  const auto opened = daemon::Session::Open(rig.folder() / "state", session);
  EXPECT_TRUE(opened.ok()) << opened.status();
  if (!opened.ok()) return frames;
  const auto entries = (*opened)->Entries();
  EXPECT_TRUE(entries.ok()) << entries.status();
  for (const daemon::JournalEntry& entry : entries.value_or(std::vector<daemon::JournalEntry>())) {
    std::printf("journal: %.3f s %s\n", static_cast<double>(entry.rig_ns) * 1e-9, entry.text.c_str());
  }
  for (int camera = 0; camera < 3; ++camera) {
    for (uint64_t cursor = 0;;) {
      const auto frame = (*opened)->Next(camera, cursor, 0);
      EXPECT_TRUE(frame.ok()) << frame.status();
      if (!frame.ok() || !*frame) break;
      cursor = (*frame)->record.sequence;
      frames[{(*frame)->record.shot, camera}] = *(*frame)->pixels;
    }
  }
  return frames;
}

// The plan in lockstep, on no bus at all.
inline Frames LocalFrames() {
  const RigFiles files({});
  const RunningRig rig(files.Options("local.toml"));
  return FramesOf(rig, rig.RunPlan(files.plan()).value("session_id", ""));
}

// Noise is a function of what was commanded: only the light of a lamp that is not quite warm may
// differ.
inline void ExpectSame(const Frames& frames, const Frames& local) {
  ASSERT_EQ(local.size(), kFrames);
  ASSERT_EQ(frames.size(), kFrames);
  int worst = 0;
  size_t differing = 0, pixels = 0;
  for (const auto& [which, bytes] : frames) {
    const std::string& other = local.at(which);
    ASSERT_EQ(bytes.size(), other.size());
    for (size_t i = 0; i + 1 < bytes.size(); i += 2, ++pixels) {
      const auto dn = [i](const std::string& of) {
        return static_cast<uint8_t>(of[i]) | static_cast<uint8_t>(of[i + 1]) << 8;
      };
      const int off = std::abs(dn(bytes) - dn(other));
      differing += off > 0;
      worst = std::max(worst, off);
    }
  }
  std::printf("%zu frames, %zu pixels: %zu differ from the local run's, by %d of 4095 DN at most\n",
              frames.size(), pixels, differing, worst);
  EXPECT_LE(worst, 4);
}

// A run that something happened to ends; what it lacks is taken by a resume.
inline void ExpectWholeInTheEnd(const RealRig& rig, Service& run, const Frames& local) {
  ASSERT_TRUE(hil::Eventually([&] { return !run.Running(); })) << run.Log() << rig.AllLogs();
  const std::string session = rig.LastSession();
  if (run.Log().find("\"complete\":true") == std::string::npos) {
    const Outcome resumed =
        rig.Mesorig({"resume", session, "--sample", "weave", "--no-products", "--json"});
    EXPECT_THAT(resumed.text, ::testing::HasSubstr("\"complete\":true")) << run.Log() << rig.AllLogs();
  }
  ASSERT_NO_FATAL_FAILURE(ExpectSame(FramesOf(rig, session), local));
}

}  // namespace mesorig::test
