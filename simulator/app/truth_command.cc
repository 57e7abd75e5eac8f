// mesorig-sim truth: the exact BTF of a sample, at the texels and directions of a file.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "processing/btf/btf_file.h"
#include "protocol/base/program.h"
#include "simulator/app/commands.h"
#include "simulator/world/sample.h"
#include "simulator/world/truth.h"

namespace mesorig::simulator {
namespace {

struct TruthArguments {
  std::string sample, like, out;
  int strata = 4, threads = 2;
  bool nominal = false, json = false;
};

// A bar on a terminal, for what takes more than two seconds.
std::function<void(double)> ProgressBar() {
  if (isatty(STDERR_FILENO) == 0) return {};
  const auto start = std::chrono::steady_clock::now();
  return [start](double fraction) {
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    if (elapsed.count() < 2) return;
    const int filled = static_cast<int>(40 * fraction);
    fmt::print(stderr, "\rtruth [{}{}] {:3.0f} %{}", std::string(filled, '#'),
               std::string(40 - filled, ' '), 100 * fraction, fraction < 1 ? "" : "\n");
    std::fflush(stderr);
  };
}

std::string Provenance(const world::Sample& sample, const TruthArguments& arguments) {
  const nlohmann::json provenance = {
      {"program", fmt::format("mesorig-sim truth {}", kVersion)},
      {"sample", sample.surface.name},
      {"sample_sha256", sample.sha256},
      {"like", std::filesystem::path(arguments.like).filename().string()},
      {"strata", arguments.strata},
      {"nominal", arguments.nominal},
  };
  return provenance.dump();
}

void Report(const TruthArguments& arguments, const world::Truth& truth, double total_s) {
  const btf::BtfHeader& header = truth.btf.header();
  if (arguments.json) {
    nlohmann::json figures = {
        {"out", arguments.out},
        {"width", header.width},
        {"height", header.height},
        {"views", header.view_count()},
        {"lights", header.light_count()},
        {"pairs", truth.btf.present_count()},
        {"strata", arguments.strata * arguments.strata},
        {"trace_s", truth.seconds},
        {"wall_s", total_s},
        {"standard_error", nullptr},
    };
    if (truth.standard_error) figures["standard_error"] = *truth.standard_error;
    fmt::print("{}\n", figures.dump(2));
    return;
  }
  fmt::print("{}: {} x {} texels, {} views x {} lights, {} pairs, {} rays a texel\n", arguments.out,
             header.width, header.height, header.view_count(), header.light_count(),
             truth.btf.present_count(), arguments.strata * arguments.strata);
  fmt::print("{:.2f} s ({:.2f} s in all); standard error {} sr^-1\n", truth.seconds, total_s,
             truth.standard_error ? fmt::format("<= {:.3g}", *truth.standard_error) : "unknown");
}

Status RunTruth(const TruthArguments& arguments) {
  const auto start = std::chrono::steady_clock::now();
  const std::filesystem::path folder = std::filesystem::path(arguments.out).parent_path();
  if (!folder.empty() && !std::filesystem::is_directory(folder)) {
    return NotFound("{}: its folder does not exist", arguments.out);
  }
  MESORIG_ASSIGN_OR_RETURN(const world::Sample sample, world::LoadSample(arguments.sample));
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo like, btf::ReadBtfInfo(arguments.like));
  MESORIG_ASSIGN_OR_RETURN(const auto world, world::World::Build(sample.surface));
  world::TruthOptions options;
  options.strata = arguments.strata;
  options.nominal = arguments.nominal;
  options.threads = arguments.threads;
  options.progress = ProgressBar();
  auto truth = world::ComputeTruth(*world, like.header, like.present, options);
  if (!truth.ok()) return Annotate(truth.status(), arguments.like);
  truth->btf.mutable_header().provenance_json = Provenance(sample, arguments);
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(truth->btf, arguments.out));
  const std::chrono::duration<double> total = std::chrono::steady_clock::now() - start;
  Report(arguments, *truth, total.count());
  return OkStatus();
}

}  // namespace

Command AddTruthCommand(CLI::App& app) {
  auto arguments = std::make_shared<TruthArguments>();  // shared by the options and the run
  CLI::App* truth = app.add_subcommand(
      "truth", "write the exact values of a sample's BTF at the texels and directions of a file");
  truth->add_option("--sample", arguments->sample, "sample file, e.g. rigs/samples/weave.toml")
      ->required();
  truth->add_option("--like", arguments->like, "BTF file whose texels, directions and presence count")
      ->required();
  truth->add_option("--out", arguments->out, "BTF file to write")->required();
  truth->add_option("--samples", arguments->strata, "rays a texel and view: N x N (default 4)")
      ->check(CLI::Range(1, 64));
  truth->add_option("--threads", arguments->threads, "threads (default 2)")
      ->check(CLI::Range(1, 256));
  truth->add_flag("--nominal", arguments->nominal,
                  "take the file's directions everywhere, as if cameras and lamps were far away");
  truth->add_flag("--json", arguments->json, "print figures as JSON");
  return {truth, [arguments] { return RunTruth(*arguments); }};
}

}  // namespace mesorig::simulator
