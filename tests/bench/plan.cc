// Time of compiling a plan against its size: grids of growing frame counts, and the paper's
// capture.

#include "protocol/plan/plan.h"

#include <benchmark/benchmark.h>

#include <chrono>

#include "protocol/base/check.h"
#include "protocol/base/file_writer.h"

namespace mesorig {
namespace {

std::filesystem::path Source(const char* path) {
  return std::filesystem::path(MESORIG_SOURCE_DIR) / path;
}

// 8 lamps and 8 cameras at each of `positions` turntable angles.
std::string Grid(int64_t positions) {
  return fmt::format(
      "name = \"grid\"\n[sample]\nname = \"s\"\n"
      "[product]\nwidth_px = 4\nheight_px = 4\npitch_mm = 1\nh_ref_mm = 4.5\n"
      "[[grid]]\nexposure_s = 0.02\n"
      "[grid.axes.turntable]\nstart_deg = 0\nstep_deg = {}\ncount = {}\n"
      "[grid.axes.light_arc]\nangles_deg = [90]\n",
      170.0 / static_cast<double>(positions), positions);
}

void Compile(benchmark::State& state, const std::string& text, const Rig& rig) {
  uint32_t frames = 0;
  const auto began = std::chrono::steady_clock::now();
  for (auto _ : state) {
    const auto plan = CompilePlan(text, "plan.toml", rig);
    MESORIG_CHECK(plan.ok());
    frames = plan->frames;
  }
  const std::chrono::duration<double, std::micro> us = std::chrono::steady_clock::now() - began;
  state.counters["frames"] = frames;
  state.counters["us_per_frame"] = us.count() / static_cast<double>(state.iterations()) / frames;
}

void CompileGrid(benchmark::State& state) {
  static const Rig rig = LoadRig(Source("rigs/demo.toml")).value();
  Compile(state, Grid(state.range(0)), rig);
}
BENCHMARK(CompileGrid)
    ->Arg(2)
    ->Arg(16)
    ->Arg(160)
    ->Arg(1600)
    ->Arg(16000)
    ->Unit(benchmark::kMillisecond);

void CompileWang2005(benchmark::State& state) {
  const Rig rig = LoadRig(Source("rigs/wang2005.toml")).value();
  Compile(state, ReadFile(Source("plans/wang2005.toml")).value(), rig);
}
BENCHMARK(CompileWang2005)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mesorig

BENCHMARK_MAIN();
