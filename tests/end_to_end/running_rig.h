#pragma once
// The tiny rig, running: what the end-to-end tests talk to.

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "protocol/base/digest.h"
#include "protocol/base/file_writer.h"
#include "tests/end_to_end/process.h"

namespace mesorig::test {

inline const std::string kSource = MESORIG_SOURCE_DIR;
inline const std::string kTiny = kSource + "/tests/end_to_end/";

struct RunningRigOptions {
  bool daemon = true, processing = false;  // started at once
  std::string seed = "7";
  std::string rig = kTiny + "tiny_rig.toml";
  std::string sample = kSource + "/rigs/samples/weave.toml";
  int samples_per_side = 2;
};

// Simulator, daemon and, when asked for, the processing service of the tiny rig as processes, in a
// folder of their own.
class RunningRig {
 public:
  explicit RunningRig(RunningRigOptions options) : options_(std::move(options)) {
    StartSimulator();
    if (options_.daemon) StartDaemon();
    if (options_.processing) StartProcessing();
  }
  explicit RunningRig(bool processing, std::string seed = "7")
      : RunningRig(RunningRigOptions{.processing = processing, .seed = std::move(seed)}) {}
  // The first time, or after an end.
  void StartSimulator() {
    sim_ = Start("mesorig-sim", {"run", "--rig", options_.rig, "--sample",
                                 options_.sample, "--seed", options_.seed, "--samples-per-side",
                                 std::to_string(options_.samples_per_side), "--log",
                                 (folder_ / "rig.tsv").string()});
  }
  void StartDaemon(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"--rig", options_.rig, "--state-dir",
                                          (folder_ / "state").string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    daemon_ = Start("mesorigd", std::move(arguments));
  }
  void StartProcessing() {
    processing_ = Start("mesorig-processd", {"--products", (folder_ / "products").string()});
  }
  Outcome Mesorig(std::vector<std::string> arguments) const {
    arguments.insert(arguments.end(), {"--runtime-dir", folder_.path().string()});
    return RunProgram("mesorig", arguments);
  }
  Outcome Inject(std::vector<std::string> words) const {
    words.insert(words.begin(), "inject");
    words.insert(words.end(), {"--runtime-dir", folder_.path().string()});
    return RunProgram("mesorig-sim", words);
  }
  // Runs tests/end_to_end/<plan>, or one at an absolute path, to its end. The simulator's operator answers prompts.
  nlohmann::json RunPlan(const std::string& plan = "tiny_plan.toml") const {
    std::vector<std::string> arguments = {"run", std::filesystem::path(kTiny) / plan, "--json", "--on-prompt", Operator()};
    if (processing_ == nullptr) arguments.push_back("--no-products");
    const Outcome outcome = Mesorig(arguments);
    EXPECT_EQ(outcome.code, 0) << outcome.text << Logs();
    // (Prompts come first, on stderr.)
    const auto json = nlohmann::json::parse(
        outcome.text.substr(std::min(outcome.text.size(), outcome.text.find('{'))), nullptr, false);
    EXPECT_TRUE(json.is_object()) << outcome.text;
    return json.is_object() ? json : nlohmann::json::object();
  }
  // A shell command that does what a prompt asks for.
  std::string Operator() const {
    return fmt::format(
        "'{}/mesorig-sim' inject operator remount \"$MESORIG_PROMPT_MOUNT\" "
        "--runtime-dir '{}'",
        MESORIG_BIN_DIR, folder_.path().string());
  }
  std::string RigLog() const { return ReadFile(folder_ / "rig.tsv").value_or(""); }
  // Digests of the frames on disk, camera by camera: segments hold pixels and digests, no times.
  std::map<std::string, std::string> SegmentDigests(const std::string& session) const {
    std::map<std::string, std::string> digests;
    const auto root = folder_ / "state" / session;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
      if (entry.path().extension() != ".seg") continue;
      digests[entry.path().lexically_relative(root).string()] =
          FrameDigest(ReadFile(entry.path()).value());
    }
    return digests;
  }
  std::string Logs() const {
    std::string logs;
    for (const auto* service : {sim_.get(), daemon_.get(), processing_.get()}) {
      if (service != nullptr) logs += service->Log();
    }
    return logs;
  }
  const TemporaryFolder& folder() const { return folder_; }
  Service& sim() { return *sim_; }
  Service& daemon() { return *daemon_; }
  Service& processing() { return *processing_; }

 private:
  std::unique_ptr<Service> Start(const std::string& program, std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--runtime-dir", folder_.path().string()});
    std::filesystem::remove(folder_ / (program + ".endpoint"));  // a kill leaves it
    auto service = std::make_unique<Service>(program, arguments, folder_ / (program + ".log"));
    EXPECT_TRUE(AwaitFile(folder_ / (program + ".endpoint"))) << service->Log();
    return service;
  }
  const RunningRigOptions options_;
  TemporaryFolder folder_;
  std::unique_ptr<Service> sim_, daemon_, processing_;  // ended in the reverse order
};

}  // namespace mesorig::test
