// bench_ingest: can the session keep up with eight cameras, and how far is it from what the machine
// can do? README.md tells what the columns mean.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <thread>

#include "daemon/service/books.h"
#include "protocol/base/check.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/frame_memory.h"
#include "protocol/base/mutex.h"
#include "protocol/base/program.h"
#include "tests/bench/consumer.h"
#include "tests/bench/raw_copies.h"

namespace mesorig::bench {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

constexpr double kRate_hz = 15;
constexpr double kLate_ms = 100 + 1000 / kRate_hz;  // after the trigger

// When which frame became durable, by the session's own count.
class Durable {
 public:
  explicit Durable(daemon::Session& session) {
    session.OnDurable([this](uint32_t frames) {
      MutexLock lock(mutex_);
      groups_.push_back({frames, Clock::now()});
    });
  }
  struct Group {
    uint32_t frames;  // so far
    Clock::time_point at;
  };
  std::vector<Group> groups() const {
    MutexLock lock(mutex_);
    return groups_;
  }

 private:
  mutable Mutex mutex_;
  std::vector<Group> groups_ GUARDED_BY(mutex_);
};

struct Options {
  std::filesystem::path dir, json_path;
  double seconds = 60;
  double full_speed_gb = 2;
};

// A shot every period of the host's clock, durable and streamed.
json Paced(const Options& options, Pixels pixels, const std::filesystem::path& dir) {
  const auto shots = static_cast<uint32_t>(options.seconds * kRate_hz);
  const PatternSource source(MESORIG_SOURCE_DIR, pixels, shots);
  const auto books = daemon::Books::Open(dir / "sessions", nullptr, [] { return 0.0; }).value();
  const auto session = books->sessions.Create(source.plan(), source.rig()).value();
  const Durable durable(*session);
  Child consumer;
  std::vector<Clock::time_point> triggers;
  uint32_t waited = 0;
  json result;
  {
    const FramesServer server(dir, *books);
    consumer =
        Child::Start({"consume", server.endpoint(), session->id(), std::to_string(kLate_ms)}, {});
    std::this_thread::sleep_for(std::chrono::milliseconds(500));  // it connects
    const double cpu_before = CpuSeconds();
    const auto began = Clock::now();
    for (uint32_t shot = 0; shot < shots; ++shot) {
      const auto trigger = began + std::chrono::duration_cast<Clock::duration>(
                                       std::chrono::duration<double>(shot / kRate_hz));
      std::this_thread::sleep_until(trigger);
      triggers.push_back(trigger);
      MESORIG_CHECK(source.Shoot(*session, shot, trigger).ok());
      if (SecondsSince(trigger) > 1 / kRate_hz) ++waited;  // the next trigger came while it waited
    }
    MESORIG_CHECK(session->Flush().ok());
    result["cpu_s"] = CpuSeconds() - cpu_before;
    MESORIG_CHECK(session->Finish(false, "a benchmark", 0, 0, true).ok());
    result["consumer"] = consumer.Result();
  }
  uint64_t late = 0;
  double worst_ms = 0;
  uint32_t frame = 0;
  for (const Durable::Group& group : durable.groups()) {
    for (; frame < group.frames; ++frame) {
      const double ms =
          std::chrono::duration<double, std::milli>(group.at - triggers[frame / kCameras]).count();
      worst_ms = std::max(worst_ms, ms);
      if (ms > kLate_ms) ++late;
    }
  }
  MESORIG_CHECK(frame == shots * kCameras);
  result["frames"] = frame, result["seconds"] = options.seconds;
  result["mb_per_s"] = 1e-6 * static_cast<double>(source.shot_bytes()) * kRate_hz;
  result["late"] = late, result["worst_ms"] = worst_ms, result["source_waited"] = waited;
  return result;
}

// As fast as Append takes it; with `streamed` a consumer follows. MB/s until the last is durable
// (and received).
json FullSpeed(const Options& options, bool streamed, const std::filesystem::path& dir,
               std::vector<uint32_t>* groups) {
  const PatternSource one(MESORIG_SOURCE_DIR, Pixels::kBayer, 1);
  const auto shots =
      static_cast<uint32_t>(options.full_speed_gb * 1e9 / static_cast<double>(one.shot_bytes()));
  const PatternSource source(MESORIG_SOURCE_DIR, Pixels::kBayer, shots);
  const auto books = daemon::Books::Open(dir / "sessions", nullptr, [] { return 0.0; }).value();
  const auto session = books->sessions.Create(source.plan(), source.rig()).value();
  const Durable durable(*session);
  json result;
  {
    const FramesServer server(dir, *books);
    Child consumer;
    if (streamed) {
      consumer = Child::Start({"consume", server.endpoint(), session->id(), "1e9"}, {});
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    }
    const auto began = Clock::now();
    for (uint32_t shot = 0; shot < shots; ++shot) {
      MESORIG_CHECK(source.Shoot(*session, shot, Clock::now()).ok());
    }
    MESORIG_CHECK(session->Flush().ok());
    const double durable_s = SecondsSince(began);
    MESORIG_CHECK(session->Finish(false, "a benchmark", 0, 0, true).ok());
    if (streamed) result["consumer"] = consumer.Result();
    const double mb = 1e-6 * static_cast<double>(source.shot_bytes()) * shots;
    result["durable_mb_per_s"] = mb / durable_s;
    if (streamed) result["mb_per_s"] = mb / SecondsSince(began);
    if (!streamed) result["mb_per_s"] = mb / durable_s;
  }
  if (groups != nullptr) {
    uint32_t before = 0;
    groups->clear();
    for (const Durable::Group& group : durable.groups()) {
      groups->push_back(group.frames - before);
      before = group.frames;
    }
  }
  // A second time from the session that has ended: streaming alone.
  if (!streamed) {
    const FramesServer server(dir, *books);
    Child consumer = Child::Start({"consume", server.endpoint(), session->id(), "1e9"}, {});
    const json read = consumer.Result();
    result["stream_mb_per_s"] = 1e-6 * read["bytes"].get<double>() / read["wall_s"].get<double>();
  }
  return result;
}

// Every measurement in a folder of its own that goes with it.
template <typename Measure>
json InFolder(const Options& options, Measure measure) {
  std::string name = (options.dir / "mesorig-bench-XXXXXX").string();
  MESORIG_CHECK(::mkdtemp(name.data()) != nullptr);
  json result = measure(std::filesystem::path(name));
  std::filesystem::remove_all(name);
  return result;
}

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

json AllFullSpeed(const Options& options) {
  std::vector<double> session, streamed, raw_disk, raw_socket, stream;
  std::vector<uint32_t> groups;
  const PatternSource source(MESORIG_SOURCE_DIR, Pixels::kBayer, 1);
  // Taking turns, every other round the other way round: the disk's mood is the same for all.
  const std::vector<std::function<void()>> turns = {
      [&] {
        const json plain = InFolder(
            options, [&](const auto& dir) { return FullSpeed(options, false, dir, &groups); });
        session.push_back(plain["mb_per_s"]), stream.push_back(plain["stream_mb_per_s"]);
      },
      [&] {
        if (groups.empty()) return;
        raw_disk.push_back(InFolder(
            options, [&](const auto& dir) { return json(RawWrite(source, groups, dir)); }));
      },
      [&] {
        streamed.push_back(InFolder(options, [&](const auto& dir) {
          return FullSpeed(options, true, dir, nullptr);
        })["mb_per_s"]);
      },
      [&] { raw_socket.push_back(RawSockets(source, options.full_speed_gb * 1e9)); }};
  for (size_t round = 0; round < 4; ++round) {
    for (size_t i = 0; i < turns.size(); ++i) {
      ::sync();
      turns[round % 2 == 0 ? i : turns.size() - 1 - i]();
    }
  }
  const double slower = std::min(Median(raw_disk), Median(raw_socket));
  return {{"session_mb_per_s", Median(session)},
          {"session_and_stream_mb_per_s", Median(streamed)},
          {"stream_mb_per_s", Median(stream)},
          {"raw_write_mb_per_s", Median(raw_disk)},
          {"raw_socket_mb_per_s", Median(raw_socket)},
          {"session_to_raw_write", Median(session) / Median(raw_disk)},
          {"session_and_stream_to_slower", Median(streamed) / slower},
          {"stream_to_raw_socket", Median(stream) / Median(raw_socket)}};
}

void Print(const char* name, const json& paced) {
  std::printf("%-6s %7.0f %8d %6d %9.0f %7d %7.1f | %8d %6d %9.0f %7.1f\n", name,
              paced["mb_per_s"].get<double>(), paced["frames"].get<int>(), paced["late"].get<int>(),
              paced["worst_ms"].get<double>(), paced["source_waited"].get<int>(),
              paced["cpu_s"].get<double>(), paced["consumer"]["frames"].get<int>(),
              paced["consumer"]["late"].get<int>(), paced["consumer"]["worst_ms"].get<double>(),
              paced["consumer"]["cpu_s"].get<double>());
}

Status Run(const Options& options) {
  json result;
  std::printf("8 cameras, 1024 x 768, 15 Hz, %.0f s\n", options.seconds);
  std::printf("       MB/s      durable frames               |  consumer (another process)\n");
  std::printf(
      "                    all   late  worst ms  waited  cpu s |      all   late  worst ms"
      "   cpu s\n");
  for (const auto& [name, pixels] : {std::pair{"Bayer", Pixels::kBayer}, {"RGB", Pixels::kRgb}}) {
    result[name] = InFolder(options, [&](const auto& dir) { return Paced(options, pixels, dir); });
    Print(name, result[name]);
    std::fflush(stdout);
  }
  result["full_speed"] = AllFullSpeed(options);
  for (const auto& [key, value] : result["full_speed"].items()) {
    std::printf("%-32s %10.2f\n", key.c_str(), value.get<double>());
  }
  return WriteFileAtomically(options.json_path, result.dump(2) + "\n");
}

}  // namespace
}  // namespace mesorig::bench

int main(int argc, char** argv) {
  using namespace mesorig;
  KeepFreedFrames();  // as mesorigd and mesorig-processd do
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  if (!arguments.empty() && arguments[0] == "consume") {
    return bench::Consume(arguments.at(1), arguments.at(2), std::stod(arguments.at(3)));
  }
  if (!arguments.empty() && arguments[0] == "drain") {
    std::vector<int> sockets;
    for (size_t i = 1; i < arguments.size(); ++i) sockets.push_back(std::stoi(arguments[i]));
    return bench::Drain(sockets);
  }
  CLI::App app{"Eight cameras into a session and to a consumer"};
  bench::Options options;
  app.add_option("--dir", options.dir, "where sessions are written")->required();
  app.add_option("--json", options.json_path, "figures")->required();
  app.add_option("--seconds", options.seconds, "of each paced run")->check(CLI::Range(1.0, 600.0));
  app.add_option("--full-speed-gb", options.full_speed_gb)->check(CLI::Range(0.05, 50.0));
  return RunProgram(app, "bench_ingest", argc, argv, [&] { return bench::Run(options); });
}
