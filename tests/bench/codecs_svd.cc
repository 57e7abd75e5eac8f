#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <random>

#include "processing/codecs/algebra/truncated_svd.h"
#include "protocol/base/check.h"
#include "tests/bench/codecs.h"

namespace mesorig::bench {
namespace {

using namespace codecs::algebra;

constexpr int64_t kRows = 12288, kCols = 16384, kRank = 32, kOversampling = 10;
constexpr int64_t kSmooth = 400;  // singular values that fall as a BTF's do: 1 / k
constexpr double kNoise = 0.02;   // of the RMS
constexpr int kSamePowerSteps = 4;
constexpr double kStrictStop = 1e-4;  // as exact as scikit-learn's defaults

// Smooth structure and noise.
MatrixF Example() {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  MatrixF u(kRows, kSmooth), v(kCols, kSmooth);
  for (float& x : u.values) x = normal(random);
  for (float& x : v.values) x = normal(random);
  double square = 0;
  for (int64_t k = 0; k < kSmooth; ++k) {
    const float sigma = 1.0f / static_cast<float>(k + 1);
    square += static_cast<double>(sigma) * static_cast<double>(sigma);
    for (int64_t i = 0; i < kRows; ++i) u(i, k) *= sigma;
  }
  MatrixF a = Multiply(u, false, v, true);
  const auto step = static_cast<float>(kNoise * std::sqrt(12 * square) * 0x1p-31);
  std::minstd_rand noise(2);
  for (float& x : a.values) x += step * (static_cast<float>(noise()) - 0x1p30f);
  return a;
}

// ||A - U sigma V^T|| / ||A||, from the difference itself.
double ErrorOf(const MatrixF& a, const TruncatedSvd& svd) {
  constexpr int64_t kBlock = 256;  // columns
  MatrixF scaled = svd.u;
  for (int64_t k = 0; k < scaled.cols; ++k) {
    const auto sigma = static_cast<float>(svd.sigma[static_cast<size_t>(k)]);
    for (int64_t i = 0; i < scaled.rows; ++i) scaled(i, k) *= sigma;
  }
  double error = 0, all = 0;
  for (int64_t first = 0; first < a.cols; first += kBlock) {
    const ViewF part(svd.v.values.data() + first, kBlock, svd.v.cols, svd.v.rows);
    const MatrixF said = Multiply(scaled, false, part, true);
    for (size_t i = 0; i < said.values.size(); ++i) {
      const double x = a.values[static_cast<size_t>(first * a.rows) + i], d = x - said.values[i];
      error += d * d, all += x * x;
    }
  }
  return std::sqrt(error / all);
}

struct Outcome {
  double seconds = 0, error = 0;
};
StatusOr<Outcome> Ours(const MatrixF& a, const SvdOptions& options, int& power_steps) {
  Outcome outcome;
  StatusOr<TruncatedSvd> svd = InvalidArgument("not run");
  outcome.seconds = Seconds([&] { svd = DecomposeTruncated(DenseSource(a), options); });
  MESORIG_RETURN_IF_ERROR(svd.status());
  power_steps = svd->power_steps;
  outcome.error = ErrorOf(a, *svd);
  return outcome;
}

// Runs randomized_svd.py, which answers with lines of "name seconds error".
StatusOr<nlohmann::json> Scikit(const std::filesystem::path& file) {
  const std::string command = fmt::format(
      "OPENBLAS_NUM_THREADS={} /usr/bin/python3 {}/tests/bench/randomized_svd.py {} {} {} {} {} {}",
      kThreads, MESORIG_SOURCE_DIR, file.string(), kRows, kCols, kRank, kOversampling,
      kSamePowerSteps);
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(::popen(command.c_str(), "r"), ::pclose);
  if (pipe == nullptr) return Unavailable("{}: cannot be run", command);
  std::string text;
  for (int c = 0; (c = std::fgetc(pipe.get())) != EOF;) text.push_back(static_cast<char>(c));
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) return Unavailable("{}: said `{}`", command, text);
  return json;
}

}  // namespace

StatusOr<nlohmann::json> SvdBesideScikit(const std::filesystem::path& dir) {
  const MatrixF a = Example();
  const std::filesystem::path file = dir / "bench_matrix.bin";
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(a.values.data()),
             static_cast<std::streamsize>(a.values.size() * sizeof(float)));
  SetThreads(kThreads);
  SvdOptions standard;
  standard.rank = kRank;
  standard.method = SvdMethod::kRandomised;
  SvdOptions same = standard, strict = standard;
  same.oversampling = kOversampling;
  same.max_power_steps = kSamePowerSteps;
  same.stop = -1;  // all of them
  strict.stop = kStrictStop;
  const std::pair<const char*, const SvdOptions*> settings[] = {
      {"same", &same}, {"default", &standard}, {"strict", &strict}};
  nlohmann::json json = nlohmann::json::object();
  // Taking turns, the best of each: the machine may be doing other things too.
  for (int round = 0; round < 3; ++round) {
    for (const auto& [key, options] : settings) {
      const std::string name = key;
      int steps = 0;
      MESORIG_ASSIGN_OR_RETURN(const Outcome ours, Ours(a, *options, steps));
      json[name + "_s"] = std::min(json.value(name + "_s", 1e9), ours.seconds);
      json[name + "_error"] = ours.error;
      json[name + "_power_steps"] = steps;
    }
    MESORIG_ASSIGN_OR_RETURN(const auto theirs, Scikit(file));
    for (const std::string name : {"same", "default"}) {
      const std::string key = "scikit_" + name;
      json[key + "_s"] = std::min<double>(json.value(key + "_s", 1e9), theirs[name + "_s"]);
      json[key + "_error"] = theirs[name + "_error"];
    }
  }
  std::filesystem::remove(file);
  for (const auto& [key, options] : settings) {
    const std::string name = key, peer = name == "same" ? "scikit_same_s" : "scikit_default_s";
    json[name + "_times_faster"] = json[peer].get<double>() / json[name + "_s"].get<double>();
  }
  return json;
}

}  // namespace mesorig::bench
