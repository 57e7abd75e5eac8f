// How fast codecs decode and encode (README.md).

#include "tests/bench/codecs.h"

#include <CLI/CLI.hpp>
#include <cstdio>

#include "protocol/base/file_writer.h"
#include "protocol/base/program.h"

namespace mesorig::bench {

std::vector<Vec3> Directions(int count) {
  constexpr int kPerRing = 19;
  const int rings = (count - 2 + kPerRing) / kPerRing;
  std::vector<Vec3> directions = {{0, 0, 1}};
  for (int i = 0; i + 1 < count; ++i) {
    const int ring = i / kPerRing + 1;
    directions.push_back(DirectionFromAngles(RadFromDeg(75.0 * ring / rings),
                                             2 * kPi * (i % kPerRing) / kPerRing + 0.1 * ring));
  }
  return directions;
}

namespace {

struct Options {
  std::filesystem::path dir, json_path;
  std::vector<std::string> only = {"decode", "svd", "file", "threads", "stream"};
};

Status Run(const Options& options) {
  nlohmann::json result;
  const auto measure = [&](const std::string& name, const auto& function) -> Status {
    if (std::find(options.only.begin(), options.only.end(), name) == options.only.end()) {
      return OkStatus();
    }
    MESORIG_ASSIGN_OR_RETURN(result[name], function());
    for (const auto& [key, value] : result[name].items()) {
      std::printf("%-8s%-40s %10.4g\n", name.c_str(), key.c_str(), value.template get<double>());
    }
    std::fflush(stdout);
    return OkStatus();
  };
  MESORIG_RETURN_IF_ERROR(measure("decode", [] { return DecodeRates(); }));
  MESORIG_RETURN_IF_ERROR(measure("svd", [&] { return SvdBesideScikit(options.dir); }));
  MESORIG_RETURN_IF_ERROR(measure("file", [&] { return EncodeFromFile(options.dir); }));
  MESORIG_RETURN_IF_ERROR(measure("threads", [] { return ThreadsOfEncoders(); }));
  MESORIG_RETURN_IF_ERROR(measure("stream", [&] { return PeaksOfStreams(options.dir); }));
  return WriteFileAtomically(options.json_path, result.dump(2) + "\n");
}

}  // namespace
}  // namespace mesorig::bench

int main(int argc, char** argv) {
  using namespace mesorig;
  CLI::App app{"How fast codecs decode and encode, beside peers"};
  bench::Options options;
  app.add_option("--dir", options.dir, "for files of up to a gigabyte, removed again")->required();
  app.add_option("--json", options.json_path, "figures")->required();
  app.add_option("--only", options.only, "decode, svd, file, threads, stream");
  return RunProgram(app, "bench_codecs", argc, argv, [&] { return bench::Run(options); });
}
