// mesorig-sim truth: the exact BTF or MDF of a sample, at the texels and directions of a file, and
// its relief as a mesh.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "processing/btf/btf_file.h"
#include "processing/btf/file_kind.h"
#include "processing/btf/mdf_file.h"
#include "protocol/base/program.h"
#include "simulator/app/commands.h"
#include "simulator/world/mdf_truth.h"
#include "simulator/world/sample.h"
#include "simulator/world/truth.h"

namespace mesorig::simulator {
namespace {

struct TruthArguments {
  std::string sample, like, out, mesh;
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

nlohmann::json Provenance(const world::Sample& sample, const TruthArguments& arguments) {
  const nlohmann::json provenance = {
      {"program", fmt::format("mesorig-sim truth {}", kVersion)},
      {"sample", sample.surface.name},
      {"sample_sha256", sample.sha256},
      {"like", std::filesystem::path(arguments.like).filename().string()},
  };
  return provenance;
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

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Status BtfTruth(const TruthArguments& arguments, const world::Sample& sample,
                const world::World& world) {
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo like, btf::ReadBtfInfo(arguments.like));
  world::TruthOptions options;
  options.strata = arguments.strata;
  options.nominal = arguments.nominal;
  options.threads = arguments.threads;
  options.progress = ProgressBar();
  auto truth = world::ComputeTruth(world, like.header, like.present, options);
  if (!truth.ok()) return Annotate(truth.status(), arguments.like);
  nlohmann::json provenance = Provenance(sample, arguments);
  provenance["strata"] = arguments.strata;
  provenance["nominal"] = arguments.nominal;
  truth->btf.mutable_header().provenance_json = provenance.dump();
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(truth->btf, arguments.out));
  Report(arguments, *truth, SecondsSince(start));
  return OkStatus();
}

Status MdfTruth(const TruthArguments& arguments, const world::Sample& sample,
                const world::World& world) {
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const btf::MdfFileInfo like, btf::ReadMdfInfo(arguments.like));
  auto truth = world::ComputeMdfTruth(world, like.header, arguments.threads, ProgressBar());
  if (!truth.ok()) return Annotate(truth.status(), arguments.like);
  truth->mdf.mutable_header().provenance_json = Provenance(sample, arguments).dump();
  MESORIG_RETURN_IF_ERROR(btf::WriteMdf(truth->mdf, arguments.out));
  const btf::MdfHeader& header = truth->mdf.header();
  if (arguments.json) {
    const nlohmann::json figures = {
        {"out", arguments.out},          {"width", header.width},   {"height", header.height},
        {"views", header.view_count()},  {"missed", truth->missed}, {"trace_s", truth->seconds},
        {"wall_s", SecondsSince(start)},
    };
    fmt::print("{}\n", figures.dump(2));
    return OkStatus();
  }
  fmt::print(
      "{}: {} x {} texels, {} views; {} rays pass by the sample; {:.2f} s ({:.2f} s in all)\n",
      arguments.out, header.width, header.height, header.view_count(), truth->missed,
      truth->seconds, SecondsSince(start));
  return OkStatus();
}

Status CheckFolder(const std::string& file) {
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  if (folder.empty() || std::filesystem::is_directory(folder)) return OkStatus();
  return NotFound("{}: its folder does not exist", file);
}

Status RunTruth(const TruthArguments& arguments) {
  if (arguments.like.empty() && arguments.mesh.empty()) {
    return InvalidArgument("give --like FILE with --out FILE, or --mesh FILE");
  }
  if (arguments.like.empty() != arguments.out.empty()) {
    return InvalidArgument("--like and --out belong together");
  }
  MESORIG_RETURN_IF_ERROR(CheckFolder(arguments.out));
  MESORIG_RETURN_IF_ERROR(CheckFolder(arguments.mesh));
  MESORIG_ASSIGN_OR_RETURN(const world::Sample sample, world::LoadSample(arguments.sample));
  MESORIG_ASSIGN_OR_RETURN(const auto world, world::World::Build(sample.surface));
  if (!arguments.mesh.empty()) {
    MESORIG_RETURN_IF_ERROR(world::WriteMesh(*world, arguments.mesh));
    if (!arguments.json) fmt::print("{}: {}\n", arguments.mesh, sample.surface.name);
  }
  if (arguments.like.empty()) return OkStatus();
  MESORIG_ASSIGN_OR_RETURN(const btf::FileKind kind, btf::ReadFileKind(arguments.like));
  return kind == btf::FileKind::kMdf ? MdfTruth(arguments, sample, *world)
                                     : BtfTruth(arguments, sample, *world);
}

}  // namespace

Command AddTruthCommand(CLI::App& app) {
  auto arguments = std::make_shared<TruthArguments>();  // shared by the options and the run
  CLI::App* truth = app.add_subcommand(
      "truth",
      "Write the exact values of a sample at the texels and directions of a BTF or MDF file, or "
      "its relief as a mesh");
  truth->add_option("--sample", arguments->sample, "sample file, e.g. rigs/samples/weave.toml")
      ->required();
  truth->add_option("--like", arguments->like,
                    "BTF or MDF file whose texels, directions and presence count");
  truth->add_option("--out", arguments->out, "file to write, of the same kind");
  truth->add_option("--mesh", arguments->mesh,
                    "Wavefront OBJ to write: the triangles that rays meet, mm, sample frame");
  truth->add_option("--samples", arguments->strata, "BTF: rays a texel and view, N x N (default 4)")
      ->check(CLI::Range(1, 64));
  truth->add_option("--threads", arguments->threads, "threads (default 2)")
      ->check(CLI::Range(1, 256));
  truth->add_flag(
      "--nominal", arguments->nominal,
      "BTF: take the file's directions everywhere, as if cameras and lamps were far away");
  truth->add_flag("--json", arguments->json, "print figures as JSON");
  return {truth, [arguments] { return RunTruth(*arguments); }};
}

}  // namespace mesorig::simulator
