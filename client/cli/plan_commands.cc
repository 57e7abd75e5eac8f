#include <sys/statvfs.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands.h"
#include "client/cli/text.h"
#include "protocol/base/digest.h"
#include "protocol/plan/plan.h"

namespace mesorig::client {
namespace {

struct CheckOptions {
  std::string plan, rig, state_dir = ".";
};

// What is counted from the steps.
struct Counts {
  uint32_t data = 0, ambient = 0, dark = 0, flat = 0, sweep = 0;  // frames
  uint32_t meters = 0;
};

Counts CountSteps(const CompiledPlan& plan) {
  Counts counts;
  for (const Step& step : plan.steps) {
    const auto frames = static_cast<uint32_t>(step.cameras.size());
    if (step.kind == StepKind::kMeter) ++counts.meters;
    if (step.kind == StepKind::kSweep) counts.sweep += frames * step.sweep.frames;
    if (step.kind != StepKind::kShot) continue;
    switch (step.purpose) {
      case Purpose::kData:
        counts.data += frames;
        break;
      case Purpose::kAmbient:
        counts.ambient += frames;
        break;
      case Purpose::kDark:
        counts.dark += frames;
        break;
      case Purpose::kFlat:
        counts.flat += frames;
        break;
    }
  }
  return counts;
}

// What an ordinary user may still write where `path` is, or will be.
StatusOr<uint64_t> FreeBytes(const std::string& path) {
  std::filesystem::path folder = std::filesystem::absolute(path);
  std::error_code error;
  while (!std::filesystem::exists(folder, error) && folder.has_relative_path()) {
    folder = folder.parent_path();
  }
  struct statvfs disk {};
  if (::statvfs(folder.c_str(), &disk) != 0) {
    return Unavailable("{}: free space: {}", folder.string(), std::strerror(errno));
  }
  return static_cast<uint64_t>(disk.f_bavail) * disk.f_frsize;
}

// Journal rows and segment headers are a few hundred bytes a frame.
uint64_t DiskBytes(const CompiledPlan& plan) { return plan.frame_bytes + 512ull * plan.frames; }

// Of frames that are kept only until their displacement images are durable.
uint64_t ReleasedBytes(const CompiledPlan& plan, const Rig& rig) {
  uint64_t bytes = 0;
  for (const Step& step : plan.steps) {
    if (step.kind != StepKind::kSweep || step.sweep.keep_frames) continue;
    for (size_t k = 0; k < step.cameras.size(); ++k) {
      const Region& region = step.sweep.regions[k];
      bytes += uint64_t{step.sweep.frames} * static_cast<uint64_t>(region.width) *
               static_cast<uint64_t>(region.height) *
               static_cast<uint64_t>(rig.cameras[step.cameras[k]].bytes_per_pixel());
    }
  }
  return bytes;
}

double Ratio(const CompiledPlan& plan) {
  return plan.lower_bound_s > 0 ? plan.seconds / plan.lower_bound_s : 1;
}

nlohmann::json Figures(const CompiledPlan& plan, const Rig& rig, uint64_t free_bytes) {
  const Counts counts = CountSteps(plan);
  return {{"plan", plan.name},
          {"rig", rig.name},
          {"sha256", Sha256(PackPlan(plan))},
          {"sample",
           {{"name", plan.sample_name},
            {"notes", plan.sample_notes},
            {"thickness_mm", plan.sample_thickness_mm},
            {"extent_mm", plan.sample_extent_mm},
            {"sha256", plan.sample_sha256}}},
          {"h_ref_mm", plan.product.h_ref_mm},
          {"steps", plan.steps.size()},
          {"shots", plan.shots},
          {"frames", plan.frames},
          {"frames_by_purpose",
           {{"data", counts.data},
            {"ambient", counts.ambient},
            {"dark", counts.dark},
            {"flat", counts.flat},
            {"sweep", counts.sweep}}},
          {"frames_blocked", plan.frames_blocked},
          {"frames_unneeded", plan.frames_unneeded},
          {"seconds_saved", plan.seconds_saved},
          {"sweeps", plan.sweeps},
          {"meters", counts.meters},
          {"prompts", plan.prompts},
          {"frame_bytes", plan.frame_bytes},
          {"disk_bytes", DiskBytes(plan)},
          {"released_bytes", ReleasedBytes(plan, rig)},
          {"free_bytes", free_bytes},
          {"fits", DiskBytes(plan) <= free_bytes},
          {"seconds", plan.seconds},
          {"homing_s", plan.homing_s},
          {"lower_bound_s", plan.lower_bound_s},
          {"bottleneck", plan.bottleneck},
          {"ratio", Ratio(plan)},
          {"lamp_hours", plan.lamp_seconds / 3600}};
}

void PrintFrames(const CompiledPlan& plan) {
  const Counts counts = CountSteps(plan);
  fmt::print("  frames       {} in {} shots and {} steps:", plan.frames, plan.shots,
             plan.steps.size());
  const char* between = " ";
  for (const auto& [count, what] :
       {std::pair{counts.data, "under lamps"}, std::pair{counts.sweep, "of laser sweeps"},
        std::pair{counts.dark, "dark"}, std::pair{counts.flat, "flat"},
        std::pair{counts.ambient, "of ambient light"}}) {
    if (count == 0) continue;
    fmt::print("{}{} {}", between, count, what);
    between = ", ";
  }
  fmt::print("\n");
  if (plan.sweeps > 0) fmt::print("  sweeps       {} of the laser\n", plan.sweeps);
  if (plan.frames_blocked > 0) {
    fmt::print("  blocked      {} frames are left out: solids of the rig stand in the way\n",
               plan.frames_blocked);
  }
  if (plan.frames_unneeded > 0) {
    fmt::print("  not needed   {} frames are left out, as the sample's record says; saves {}\n",
               plan.frames_unneeded, DurationText(plan.seconds_saved));
  }
}

void PrintWork(const CompiledPlan& plan, const Rig& rig, uint64_t free_bytes,
               const std::string& state_dir) {
  const Counts counts = CountSteps(plan);
  if (counts.meters > 0) {
    fmt::print(
        "  metering     {} exposures are chosen before the run; the time below takes the "
        "longest\n",
        counts.meters);
  }
  fmt::print("  time         {} after homing ({})\n", DurationText(plan.seconds),
             DurationText(plan.homing_s));
  fmt::print("  lower bound  {}, by {}; the order takes {:.3f} times that\n",
             DurationText(plan.lower_bound_s), plan.bottleneck, Ratio(plan));
  fmt::print("  lamps        {:.2f} h\n", plan.lamp_seconds / 3600);
  fmt::print("  disk         {} needed, {} free at {}{}\n", BytesText(DiskBytes(plan)),
             BytesText(free_bytes), state_dir,
             DiskBytes(plan) <= free_bytes ? "" : ": DOES NOT FIT");
  if (const uint64_t released = ReleasedBytes(plan, rig); released > 0) {
    fmt::print("               {} of it, of sweeps, only until processed\n", BytesText(released));
  }
}

void PrintPrompts(const CompiledPlan& plan, const Rig& rig) {
  if (plan.prompts == 0) return;
  fmt::print("  operator     is asked {} times; what that takes is not counted\n", plan.prompts);
  uint32_t shot = 0;
  for (const Step& step : plan.steps) {
    if (step.kind == StepKind::kShot) shot = step.shot + 1;
    if (step.kind == StepKind::kSweep) shot = step.shot + step.sweep.frames;
    if (step.kind != StepKind::kPrompt && step.kind != StepKind::kMount) continue;
    const std::string text =
        step.kind == StepKind::kPrompt
            ? step.text
            : fmt::format("Mount the laser at {}.", rig.laser->mounts[step.sweep.mount].name);
    fmt::print("    {}: {}\n",
               shot == plan.shots ? std::string("at the end") : fmt::format("before shot {}", shot),
               text);
  }
}

void PrintSample(const CompiledPlan& plan) {
  fmt::print("  sample       {}", plan.sample_name);
  if (plan.sample_extent_mm > 0) fmt::print(", {:g} mm wide", plan.sample_extent_mm);
  if (plan.sample_thickness_mm > 0) fmt::print(", {:g} mm thick", plan.sample_thickness_mm);
  if (!plan.sample_notes.empty()) fmt::print(" ({})", plan.sample_notes);
  fmt::print("\n  product      {} x {} texels of {:g} mm, reference plane at {:g} mm\n",
             plan.product.width_px, plan.product.height_px, plan.product.pitch_mm,
             plan.product.h_ref_mm);
}

Status Check(const CheckOptions& options, const Common& common) {
  MESORIG_ASSIGN_OR_RETURN(const Rig rig, LoadRig(options.rig));
  MESORIG_ASSIGN_OR_RETURN(const CompiledPlan plan, CompilePlanFile(options.plan, rig));
  MESORIG_ASSIGN_OR_RETURN(const uint64_t free_bytes, FreeBytes(options.state_dir));
  if (common.json) {
    fmt::print("{}\n", Figures(plan, rig, free_bytes).dump());
  } else {
    fmt::print("plan {} on rig {}\n", plan.name, rig.name);
    PrintSample(plan);
    PrintFrames(plan);
    PrintWork(plan, rig, free_bytes, options.state_dir);
    PrintPrompts(plan, rig);
    fmt::print("  SHA-256      {}\n", Sha256(PackPlan(plan)));
  }
  if (DiskBytes(plan) <= free_bytes) return OkStatus();
  return FailedPrecondition("plan {} does not fit: it needs {}, {} has {} free", plan.name,
                            BytesText(DiskBytes(plan)), options.state_dir, BytesText(free_bytes));
}

}  // namespace

Command AddPlanCheckCommand(CLI::App& plan, Common& common) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* check = plan.add_subcommand(
      "check", "Compile a plan: frames, time, disk, what is asked of the operator, what is wrong");
  check->add_option("plan", options->plan, "Plan file")->required();
  check->add_option("--rig", options->rig, "Rig file")->required();
  check
      ->add_option("--state-dir", options->state_dir,
                   "Where the sessions will be: its disk must have room")
      ->capture_default_str();
  return {check, [options, &common] { return Check(*options, common); }};
}

}  // namespace mesorig::client
