// From an event at the rig to lamp, laser and torque off, in virtual time, per path: with the
// contactor, and with one that is welded, so that the software's ways (edge on a line, telegrams on
// the buses) are alone. Prints the table of docs/safety.md.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "daemon/drivers/driver.h"
#include "daemon/safety/safety.h"
#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

constexpr RigTime kMoment = std::chrono::seconds(60);

// The small rig with everything on at kMoment, and what happens then.
class StopTimes {
 public:
  explicit StopTimes(std::vector<std::string> at_the_moment) : sim_(rig_, Script(at_the_moment)) {
    sim_.Exclusive([&](RigTime) {
      sim_.lamps.OnPower([this](size_t, bool on, RigTime t) { Note("lamp", on, t); });
      sim_.can.OnTorque([this](size_t, bool on, RigTime t) { Note("torque", on, t); });
      sim_.laser->OnShine([this](bool on, RigTime t) { Note("laser", on, t); });
    });
    for (size_t i = 0; i < rig_.axes.size(); ++i) {
      axes_.push_back(MakeAxis("cia402", end_.context, static_cast<int>(i)).value());
      devices_.axes.push_back(axes_.back().get());
    }
    lamps_ = MakeLampBank("modbus_lamps", end_.context).value();
    lines_ = MakeDigitalLines("gpio_lines", end_.context).value();
    devices_.lamps = lamps_.get();
    devices_.lines = lines_.get();
    safety_ = std::make_unique<Safety>(*end_.link, rig_, devices_, end_.stop);
  }
  // moving: the axes are at full speed at the moment, and the laser is dark; else it shines.
  // `act`: what the daemon does at the moment.
  std::map<std::string, double> Run(bool moving, const std::function<void(Safety&)>& act = {}) {
    RigClock& clock = *end_.link;
    const RigClock::Member member(clock, "test");
    const RigClock::Activity activity(clock, Pace::kFree);
    for (Axis* axis : safety_->axes()) {
      EXPECT_EQ(axis->Enable(), OkStatus());
      EXPECT_EQ(axis->StartHoming(), OkStatus());
      EXPECT_EQ(axis->AwaitHoming(clock.Now() + std::chrono::seconds(60)), OkStatus());
    }
    EXPECT_EQ(safety_->lamps()->SwitchTo(0), OkStatus());
    safety_->AliveUntil(kMoment);
    clock.WaitUntil(kMoment - std::chrono::seconds(1), [] { return false; });
    if (moving) {
      for (Axis* axis : safety_->axes()) EXPECT_EQ(axis->StartMove(1.5), OkStatus());
    } else {
      EXPECT_EQ(safety_->gate()->Open(), OkStatus());
    }
    safety_->AliveUntil(kMoment);
    while (clock.Now() < kMoment) {  // (a sweep that makes progress)
      clock.WaitUntil(std::min(kMoment, clock.Now() + std::chrono::milliseconds(130)),
                      [] { return false; });
      safety_->gate()->Progress();
    }
    if (act) act(*safety_);
    clock.WaitUntil(kMoment + std::chrono::seconds(14), [] { return false; });
    std::map<std::string, double> after_s;
    sim_.Exclusive([&](RigTime) {
      for (const auto& [what, when] : off_at_) {
        EXPECT_EQ(on_[what], 0) << what;
        after_s[what] = Seconds(when - kMoment);
      }
    });
    return after_s;
  }
  Safety& safety() { return *safety_; }

 private:
  static std::vector<sim_wire::TimedInjection> Script(const std::vector<std::string>& texts) {
    std::vector<sim_wire::TimedInjection> script;
    for (const std::string& text : texts) script.push_back({kMoment, text});
    return script;
  }
  void Note(const std::string& what, bool on, RigTime t) {
    on_[what] += on ? 1 : -1;
    if (on_[what] == 0) off_at_[what] = t;
  }
  const Rig rig_ = SmallLaserRig();
  SimRig sim_;
  RigEnd end_{sim_, rig_};
  SafetyDevices devices_;
  std::vector<std::unique_ptr<Axis>> axes_;
  std::unique_ptr<LampBank> lamps_;
  std::unique_ptr<DigitalLines> lines_;
  std::map<std::string, int> on_;         // of the dispatcher
  std::map<std::string, RigTime> off_at_;  // likewise: when the last one went
  std::unique_ptr<Safety> safety_;
};

void Print(const char* what, const std::map<std::string, double>& off) {
  const auto text = [&](const std::string& key) {
    const auto found = off.find(key);
    return found == off.end() ? std::string("-") : fmt::format("{:.1f}", 1000 * found->second);
  };
  std::printf("| %-52s | %6s | %6s | %6s |\n", what, text("lamp").c_str(), text("laser").c_str(),
              text("torque").c_str());
}

TEST(StopTimes, FromTheEventToOff) {
  std::printf("| %-52s | %6s | %6s | %6s |\n", "off after, ms of virtual time", "lamp", "laser",
              "torque");
  const auto at_once = [](const std::map<std::string, double>& off) {
    for (const auto& [what, after_s] : off) {
      EXPECT_GE(after_s, 0) << what;
      EXPECT_LE(after_s, 0.001) << what;
    }
  };
  StopTimes sound({"lines estop open"});
  auto off = sound.Run(false);
  Print("e-stop, contactor", off);
  EXPECT_EQ(off.size(), 3u);
  at_once(off);
  EXPECT_TRUE(sound.safety().state().needs_reset_at_rig);
  StopTimes sound_moving({"lines door open"});
  off = sound_moving.Run(true);
  Print("door, contactor, axes at full speed", off);
  at_once(off);

  StopTimes welded({"lines weld", "lines estop open"});
  off = welded.Run(false);
  Print("e-stop, contactor welded: line edge, buses", off);
  EXPECT_LE(off["lamp"], 0.01);
  EXPECT_LE(off["laser"], kLaserOneShot_s + 0.01);
  EXPECT_LE(off["torque"], 0.05);
  EXPECT_NE(welded.safety().state().causes & Bit(TripCause::kContactor), 0);
  StopTimes welded_moving({"lines weld", "lines estop open"});
  off = welded_moving.Run(true);
  Print("the same, axes at full speed (they brake)", off);
  EXPECT_LE(off["torque"], 0.5);

  StopTimes stopped({});
  off = stopped.Run(false, [](Safety& safety) { EXPECT_EQ(safety.StopNow("test"), OkStatus()); });
  Print("StopNow (bus and gate)", off);
  EXPECT_LE(off["lamp"], 0.01);
  EXPECT_LE(off["laser"], kLaserOneShot_s + 0.01);
  EXPECT_LE(off["torque"], 0.05);

  StopTimes mute({"can drop 100000 in", "lines weld", "lines estop open"});
  off = mute.Run(false);
  Print("e-stop, welded, CAN dead (drives' heartbeat 0x1016)", off);
  EXPECT_LE(off["torque"], 2.1);
  StopTimes hung({});
  off = hung.Run(false, [](Safety& safety) {
    safety.AliveUntil(kMoment - std::chrono::seconds(12));  // the last word is long ago
    safety.gate()->Shut();
  });
  Print("sequencer without a word for kAlive_s", off);
  EXPECT_LE(off["lamp"], 0.2);
}

}  // namespace
}  // namespace mesorig::daemon
