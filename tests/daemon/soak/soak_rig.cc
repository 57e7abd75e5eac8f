#include "tests/daemon/soak/soak_rig.h"

#include "protocol/base/check.h"

namespace mesorig::daemon {
namespace {

constexpr std::chrono::seconds kHang{60};  // of host time

void Replace(std::string& text, std::string_view from, std::string_view to) {
  const size_t at = text.find(from);
  MESORIG_CHECK(at != text.npos);
  text.replace(at, from.size(), to);
}

// A fault, and seconds later what mends it.
struct Mishap {
  std::string fault;
  double after_s = 0;
  std::vector<std::string> mending;
};

const std::vector<Mishap>& Mishaps() {
  static const std::vector<Mishap> mishaps = {
      {"can turntable drop 2", 0, {}},
      {"can arc corrupt 2", 0, {}},
      {"can turntable duplicate 4", 0, {}},
      {"can arc delay 200 3", 0, {}},
      {"can arc disconnect", 1, {"can arc replug"}},
      {"can disconnect", 1.5, {"can replug"}},
      {"can turntable stuck", 2, {"can turntable free"}},
      {"can arc lose 2", 0, {}},
      {"can turntable lose -0.5", 0, {}},
      {"lamps drop 2", 0, {}},
      {"lamps delay 300", 0, {}},
      {"lamps corrupt 3", 0, {}},
      {"lamps exception 2", 0, {}},
      {"lamps close", 0, {}},
      {"lamps disconnect", 1, {"lamps replug"}},
      {"lamps dead L1", 4, {"lamps alive L1"}},
      {"lines drop", 0, {}},
      {"lines door open", 3, {"lines door close", "lines reset"}},
      {"lines estop open", 5, {"lines estop close", "lines reset"}},
      {"camera:1000 drop", 0, {}},
      {"camera:1000 delay 700 2", 0, {}},
      {"camera:1001 corrupt 2", 0, {}},
      {"camera:1000 duplicate 2", 0, {}},
      {"camera:1001 disconnect", 1.5, {"camera:1001 replug"}},
      {"camera:1000 silent 2", 0, {}},
      {"camera:1000 torn 2", 0, {}},
      {"camera:1001 stale", 0, {}},
      {"camera:1000 wrong_id 2", 0, {}},
      {"camera:1000 clock -3", 0, {}},
      {"rig leap 5", 0, {}},
  };
  return mishaps;
}

}  // namespace

Rig MakeSoakRig() {
  std::string text = fixtures::SmallRig().source_text;
  Replace(text, "heartbeat_s = 0.5", "heartbeat_s = 4");
  Replace(text, "timeout_s = 1", "timeout_s = 8");
  Replace(text, "max_velocity_deg_s = 90", "max_velocity_deg_s = 20");
  return ParseRig(text, "soak.toml").value();
}

std::vector<sim_wire::TimedInjection> MakeSoakFaults(std::mt19937& random, double begin_s,
                                                     double virtual_s, double every_s) {
  std::vector<sim_wire::TimedInjection> faults;
  for (double at_s = begin_s; at_s < virtual_s;) {
    const Mishap& mishap = Mishaps()[random() % Mishaps().size()];
    faults.push_back({FromSeconds(at_s), mishap.fault});
    double mend_s = at_s + mishap.after_s;
    for (const std::string& mending : mishap.mending) {
      faults.push_back({FromSeconds(mend_s), mending});
      mend_s += 0.5;
    }
    at_s = mend_s + 1 + every_s * 2 * static_cast<double>(random() % 1000) / 1000;
  }
  return faults;
}

SoakRig::SoakRig(std::vector<sim_wire::TimedInjection> faults)
    : bench_(std::move(faults), MakeSoakRig()) {
  bench_.sequencer->OnEvent([this](const SequencerEvent& event) { Hear(event); });
}

void SoakRig::Hear(const SequencerEvent& event) {
  std::lock_guard lock(mutex_);
  ++counts_[event.kind];
  if (event.kind == SequencerEvent::Kind::kEnded) end_event_ = event;
  if (event.kind == SequencerEvent::Kind::kNote &&
      event.text.find("trying again in") != std::string::npos) {
    ++recoveries_;
  }
  heard_.notify_all();
}

void SoakRig::Idle(double seconds) {
  RigClock::Member member(*bench_.end.link, "soak");
  RigClock::Activity activity(*bench_.end.link, Pace::kFree);
  bench_.end.link->SleepFor(FromSeconds(seconds));
}

void SoakRig::CloseChain() {
  for (const char* hand : {"lines estop close", "lines door close", "lines reset"}) {
    (void)bench_.sim.Inject(hand);  // (what is closed already says so)
  }
}

std::string SoakRig::StillOn() {
  std::string on;
  bench_.sim.Exclusive([&](RigTime now) {
    const auto levels = bench_.sim.lamps.CommandedLevels();
    for (size_t i = 0; i < levels.size(); ++i) {
      if (levels[i] > 0 || bench_.sim.lamps.Coil(bench_.rig.lamps[i].channel)) on += bench_.rig.lamps[i].name + " ";
    }
    for (size_t i = 0; i < bench_.rig.axes.size(); ++i) {
      const bool moves = bench_.sim.can.node(i).Moving(now);
      if (bench_.sim.can.node(i).torque_on() || moves) on += bench_.rig.axes[i].name + " ";
    }
  });
  return on;
}

double SoakRig::PositionError() {
  double worst = 0;
  const SequencerStatus status = bench_.sequencer->GetStatus();
  bench_.sim.Exclusive([&](RigTime now) {
    for (size_t i = 0; i < bench_.rig.axes.size(); ++i) {
      for (const Reading& reading : status.readings) {
        if (reading.name != bench_.rig.axes[i].name) continue;
        const double world_rad =
            bench_.sim.can.node(i).WorldCounts(now) / bench_.rig.axes[i].counts_per_turn * 2 * kPi;
        worst = std::max(worst, std::abs(reading.value - world_rad));
      }
    }
  });
  return worst;
}

bool SoakRig::Await(SequencerEvent::Kind kind, uint32_t count) {
  std::unique_lock lock(mutex_);
  heard_.wait_for(lock, kHang, [&] {
    return counts_[kind] >= count || counts_[SequencerEvent::Kind::kEnded] > 0;
  });
  return counts_[kind] >= count;
}

bool SoakRig::AwaitState(SequencerState state) {
  std::unique_lock lock(mutex_);
  return heard_.wait_for(lock, kHang, [&] {
    const SequencerState now = bench_.sequencer->GetStatus().state;
    return now == state || !InSession(now);
  });
}

void SoakRig::Forget() {
  std::lock_guard lock(mutex_);
  counts_.clear();
}

SequencerEvent SoakRig::end() const {
  std::lock_guard lock(mutex_);
  return end_event_;
}

uint32_t SoakRig::recoveries() const {
  std::lock_guard lock(mutex_);
  return recoveries_;
}

}  // namespace mesorig::daemon
