#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "protocol/base/digest.h"
#include "protocol/plan/plan.h"

namespace mesorig::client {
namespace {

struct CheckOptions {
  std::string plan, rig;
};

Status Check(const CheckOptions& options, const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const Rig rig, LoadRig(options.rig));
  MESORIG_ASSIGN_OR_RETURN(const CompiledPlan plan, CompilePlanFile(options.plan, rig));
  const std::string sha256 = Sha256(PackPlan(plan));
  if (common.json) {
    const nlohmann::json figures = {{"plan", plan.name},
                                    {"rig", rig.name},
                                    {"sha256", sha256},
                                    {"steps", plan.steps.size()},
                                    {"shots", plan.shots},
                                    {"frames", plan.frames},
                                    {"frames_blocked", plan.frames_blocked},
                                    {"sweeps", plan.sweeps},
                                    {"prompts", plan.prompts},
                                    {"frame_bytes", plan.frame_bytes},
                                    {"seconds", plan.seconds},
                                    {"lamp_hours", plan.lamp_seconds / 3600}};
    fmt::print("{}\n", figures.dump());
    return OkStatus();
  }
  fmt::print("plan {} on rig {}\n", plan.name, rig.name);
  fmt::print("  {} steps, {} shots, {} frames ({} left out: blocked by solids)\n",
             plan.steps.size(), plan.shots, plan.frames, plan.frames_blocked);
  if (plan.sweeps > 0) {
    fmt::print("  {} sweeps of the laser; the operator is asked {} times\n", plan.sweeps,
               plan.prompts);
  }
  fmt::print("  {} of frames, about {} at the rig after homing, {:.2f} lamp-hours\n",
             BytesText(plan.frame_bytes), DurationText(plan.seconds), plan.lamp_seconds / 3600);
  fmt::print("  SHA-256 {}\n", sha256);
  return OkStatus();
}

}  // namespace

Command AddPlanCheckCommand(CLI::App& plan, Common& common) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* check = plan.add_subcommand(
      "check", "Compile a plan: steps, frames, bytes, seconds, and what is wrong");
  check->add_option("plan", options->plan, "Plan file")->required();
  check->add_option("--rig", options->rig, "Rig file")->required();
  return {check, [options, &common] { return Check(*options, common); }};
}

}  // namespace mesorig::client
