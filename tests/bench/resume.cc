// Time of opening and of resuming a session against the frames that it has: reading the journal,
// and nothing that grows beside.

#include <benchmark/benchmark.h>
#include <unistd.h>

#include <map>

#include "daemon/session/session.h"
#include "protocol/base/check.h"
#include "tests/bench/pattern_source.h"

namespace mesorig::daemon {
namespace {

using bench::kCameras;

Rig TinyRig() {
  auto rig = LoadRig(std::filesystem::path(MESORIG_SOURCE_DIR) / "rigs/demo.toml").value();
  MESORIG_CHECK(rig.cameras.size() == kCameras);
  return rig;
}

// Sessions of so many frames of 4 x 4 pixels that were killed before their last shot; kept while
// the program runs.
class Killed {
 public:
  Killed() {
    std::string name = (std::filesystem::temp_directory_path() / "mesorig-bench-XXXXXX").string();
    MESORIG_CHECK(::mkdtemp(name.data()) != nullptr);
    root_ = name;
  }
  ~Killed() { std::filesystem::remove_all(root_); }
  const std::filesystem::path& root() const { return root_; }
  const Rig& rig() const { return rig_; }
  const std::string& Get(uint32_t frames) {
    std::string& id = ids_[frames];
    if (!id.empty()) return id;
    const uint32_t shots = frames / kCameras;
    const auto session = Session::Create(root_, bench::PatternPlan(rig_, shots + 1), rig_).value();
    const auto pixels = std::make_shared<const std::string>(16, 'p');
    for (uint32_t i = 0; i < frames; ++i) {
      FrameRecord record;
      record.camera = static_cast<int>(i % kCameras);
      record.shot = i / kCameras, record.trigger_id = record.shot + 1;
      record.frame_id = record.shot + 1;
      record.exposure_s = 0.02;
      record.axis_rad.assign(rig_.axes.size(), 0);
      record.lamp_level.assign(rig_.lamps.size(), 0);
      record.width = 4, record.height = 4, record.bits = 8;
      MESORIG_CHECK(session->Append(std::move(record), pixels).ok());
    }
    MESORIG_CHECK(session->Flush().ok());
    id = session->id();
    return id;
  }

 private:
  const Rig rig_ = TinyRig();
  std::filesystem::path root_;
  std::map<uint32_t, std::string> ids_;
};

Killed& TheKilled() {
  static Killed killed;
  return killed;
}

void Report(benchmark::State& state) {
  state.counters["s_per_1e5_rows"] = benchmark::Counter(
      static_cast<double>(state.range(0)) / 1e5,
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void Open(benchmark::State& state) {
  const std::string& id = TheKilled().Get(static_cast<uint32_t>(state.range(0)));
  for (auto _ : state) MESORIG_CHECK(Session::Open(TheKilled().root(), id).ok());
  Report(state);
}
BENCHMARK(Open)->Arg(1000)->Arg(10'000)->Arg(100'000)->Unit(benchmark::kMillisecond)->UseRealTime();

// To the first question that the sequencer asks: what is missing.
void Resume(benchmark::State& state) {
  Killed& killed = TheKilled();
  const std::string& id = killed.Get(static_cast<uint32_t>(state.range(0)));
  for (auto _ : state) {
    const auto session = Session::Resume(killed.root(), id, killed.rig());
    if (!session.ok()) {
      state.SkipWithError(std::string(Message(session.status())).c_str());
      return;
    }
    const auto last = static_cast<uint32_t>(state.range(0)) / kCameras;
    MESORIG_CHECK((*session)->Missing(0).empty());
    MESORIG_CHECK((*session)->Missing(last).size() == kCameras);
  }
  Report(state);
}
BENCHMARK(Resume)
    ->Arg(1000)
    ->Arg(10'000)
    ->Arg(100'000)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace mesorig::daemon

BENCHMARK_MAIN();
