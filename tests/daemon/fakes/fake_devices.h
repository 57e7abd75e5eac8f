#pragma once
// Devices of a rig in memory, with one log of what was asked of them in which order. The listener
// of the log is called before each operation takes effect; what it returns fails the operation.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "daemon/device/axis.h"
#include "daemon/device/camera.h"
#include "daemon/device/digital_lines.h"
#include "daemon/device/lamp_bank.h"
#include "daemon/device/line_laser.h"
#include "daemon/device/stop_flag.h"
#include "protocol/plan/plan.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

class OperationLog {
 public:
  using Listener = std::function<Status(int index, const std::string& operation)>;
  void OnOperation(Listener listener) {
    std::lock_guard lock(mutex_);
    listener_ = std::move(listener);
  }
  Status Add(const std::string& operation) {
    int index = 0;
    Listener listener;
    {
      std::lock_guard lock(mutex_);
      index = static_cast<int>(operations_.size());
      operations_.push_back(operation);
      listener = listener_;
    }
    return listener ? listener(index, operation) : OkStatus();
  }
  std::vector<std::string> operations() const {
    std::lock_guard lock(mutex_);
    return operations_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::string> operations_;
  Listener listener_;
};

// Thread-safe: Safety reads and stops it beside its owner.
class FakeAxis final : public Axis {
 public:
  FakeAxis(RigClock& clock, const StopFlag& stop, OperationLog& log, const mesorig::Axis& axis)
      : clock_(clock), stop_(stop), log_(log), axis_(axis) {}
  const std::string& name() const override { return axis_.name; }
  Status Enable() override {
    MESORIG_RETURN_IF_ERROR(Say("enable"));
    Set([](AxisReading& reading) { reading.enabled = reading.torque = true; });
    return OkStatus();
  }
  Status Disable() override {
    // Also when the answer gets lost.
    Set([](AxisReading& reading) { reading.enabled = reading.torque = reading.moving = false; });
    return Say("disable");
  }
  Status StartHoming() override {
    MESORIG_RETURN_IF_ERROR(Say("home"));
    Begin(0, std::chrono::seconds(2));
    return OkStatus();
  }
  Status AwaitHoming(RigTime deadline) override {
    MESORIG_RETURN_IF_ERROR(Say("homed"));
    MESORIG_RETURN_IF_ERROR(Arrive(deadline));
    Set([](AxisReading& reading) { reading.referenced = true; });
    return OkStatus();
  }
  Status StartMove(double target_rad) override {
    MESORIG_RETURN_IF_ERROR(Say(fmt::format("move {:.0f}", DegFromRad(target_rad))));
    const AxisReading reading = Read();
    if (!reading.enabled || !reading.referenced) return FailedPrecondition("not ready");
    Begin(target_rad, FromSeconds(MoveSeconds(axis_, target_rad - reading.position_rad)));
    return OkStatus();
  }
  Status SetSpeed(double rad_s) override {
    return Say(fmt::format("speed {:.0f}", DegFromRad(rad_s)));
  }
  Status AwaitMove(RigTime deadline) override {
    MESORIG_RETURN_IF_ERROR(Say("there"));
    return Arrive(deadline);
  }
  Status QuickStop() override {
    Set([](AxisReading& reading) { reading.enabled = reading.torque = reading.moving = false; });
    return Say("quick stop");
  }
  AxisReading Read() const override {
    std::lock_guard lock(mutex_);
    return reading_;
  }

 private:
  Status Say(const std::string& what) { return log_.Add(axis_.name + " " + what); }
  void Set(const std::function<void(AxisReading&)>& change) {
    std::lock_guard lock(mutex_);
    change(reading_);
  }
  void Begin(double target_rad, RigTime span) {
    target_rad_ = target_rad;
    arrival_ = clock_.Now() + span;
    Set([](AxisReading& reading) { reading.moving = true; });
  }
  Status Arrive(RigTime deadline) {
    const Status waited = stop_.Wait(std::min(deadline, arrival_), [] { return false; });
    if (absl::IsCancelled(waited)) return waited;
    const RigTime now = clock_.Now();
    if (now < arrival_) return DeadlineExceeded("{}: late", axis_.name);
    Set([&](AxisReading& reading) {
      reading.position_rad = target_rad_;
      reading.read_at = now;
      reading.moving = false;
    });
    return OkStatus();
  }
  RigClock& clock_;
  const StopFlag& stop_;
  OperationLog& log_;
  const mesorig::Axis axis_;
  mutable std::mutex mutex_;
  AxisReading reading_;
  double target_rad_ = 0;
  RigTime arrival_{};
};

// First-order lamps.
class FakeLampBank final : public LampBank {
 public:
  FakeLampBank(RigClock& clock, OperationLog& log, const Rig& rig)
      : clock_(clock),
        log_(log),
        lamps_(rig.lamps),
        start_(lamps_.size()),
        target_(lamps_.size()) {}
  double brightest = 1;  // what a lamp that is on reaches
  Status Open() override { return log_.Add("lamps open"); }
  Status SwitchTo(int channel) override {
    MESORIG_RETURN_IF_ERROR(log_.Add(fmt::format("lamp {}", channel)));
    Switch(channel);
    return OkStatus();
  }
  StatusOr<std::vector<double>> ReadLevels() override {
    MESORIG_RETURN_IF_ERROR(log_.Add("levels"));
    std::lock_guard lock(mutex_);
    return LevelsNow();
  }
  // Not in the log: nobody's command.
  StatusOr<LampReadings> Watch() override {
    std::lock_guard lock(mutex_);
    if (unreadable) return Unavailable("lamp bank: no answer");
    return LampReadings{LevelsNow(), housing_c};
  }
  // What happens at the bank, whoever asked for it.
  void Light(int channel) { Switch(channel); }
  std::atomic<bool> unreadable{false};  // for Watch
  std::vector<double> housing_c;  // set while nothing runs
  Status AllOff() override {
    MESORIG_RETURN_IF_ERROR(log_.Add("lamps off"));
    Switch(-1);
    return OkStatus();
  }
  bool anything_on() const {
    std::lock_guard lock(mutex_);
    for (const double target : target_) {
      if (target > 0) return true;
    }
    return false;
  }

 private:
  void Switch(int channel) {
    std::lock_guard lock(mutex_);
    start_ = LevelsNow();
    changed_ = clock_.Now();
    for (size_t i = 0; i < lamps_.size(); ++i) {
      target_[i] = lamps_[i].channel == channel ? brightest : 0;
    }
  }
  std::vector<double> LevelsNow() const {
    const double t = Seconds(clock_.Now() - changed_);
    std::vector<double> levels;
    for (size_t i = 0; i < lamps_.size(); ++i) {
      levels.push_back(target_[i] + (start_[i] - target_[i]) * std::exp(-t / lamps_[i].rise_s));
    }
    return levels;
  }
  RigClock& clock_;
  OperationLog& log_;
  const std::vector<Lamp> lamps_;
  mutable std::mutex mutex_;
  std::vector<double> start_, target_;
  RigTime changed_{};
};

class FakeLines final : public DigitalLines {
 public:
  explicit FakeLines(RigClock& clock) : clock_(clock) {}
  StatusOr<bool> Read(int line) override {
    StatusOr<bool> level = true;
    const RigTime now = clock_.Now();
    clock_.Read([&] {
      if (broken_ || fail_reads_ > 0) {
        fail_reads_ = std::max(0, fail_reads_ - 1);
        level = Unavailable("chip gone");
      } else if (line == on_) {
        level = now < lit_until_;
      } else {
        level = !open_.contains(line);
      }
    });
    if (line == hand_line_) {
      hand_line_ = -1;
      std::exchange(hand_, nullptr)();
    }
    return level;
  }
  // Just after `line` was read next, before who reads it knows: somebody at the rig.
  void AfterReading(int line, std::function<void()> hand) {
    hand_line_ = line;
    hand_ = std::move(hand);
  }
  // A rising edge of `trigger` lights `on` for the one-shot's time.
  void AddOneShot(int trigger, int on) {
    clock_.Change([&] {
      trigger_ = trigger;
      on_ = on;
    });
  }
  Status Write(int line, bool level) override {
    const RigTime now = clock_.Now();
    clock_.Change([&] {
      if (line == trigger_ && level) {
        ++edges_;
        lit_until_ = now + FromSeconds(kLaserOneShot_s);
      }
    });
    return OkStatus();
  }
  bool lit() const {
    const RigTime now = clock_.Now();
    bool lit = false;
    clock_.Read([&] { lit = now < lit_until_; });
    return lit;
  }
  int edges() const {
    int edges = 0;
    clock_.Read([&] { edges = edges_; });
    return edges;
  }
  void OnEdge(std::function<void(int, bool, RigTime)> on_edge) override {
    clock_.Change([&] { on_edge_ = std::move(on_edge); });
  }
  void Set(int line, bool level) {
    const RigTime now = clock_.Now();
    clock_.Change([&] {
      if (level) {
        open_.erase(line);
      } else {
        open_.insert(line);
      }
      if (on_edge_) on_edge_(line, level, now);
    });
  }
  void Break() {
    clock_.Change([&] { broken_ = true; });
  }
  void Mend() {
    clock_.Change([&] {
      broken_ = false;
      fail_reads_ = 0;
    });
  }
  void FailReads(int reads) {
    clock_.Change([&] { fail_reads_ = reads; });
  }

 private:
  RigClock& clock_;
  std::set<int> open_;
  int trigger_ = -1, on_ = -1, edges_ = 0;
  RigTime lit_until_{};
  bool broken_ = false;
  int fail_reads_ = 0;
  std::function<void(int, bool, RigTime)> on_edge_;
  int hand_line_ = -1;
  std::function<void()> hand_;
};

class FakeCamera final : public Camera {
 public:
  FakeCamera(RigClock& clock, const StopFlag& stop, OperationLog& log,
             const mesorig::Camera& camera)
      : clock_(clock), stop_(stop), log_(log), camera_(camera) {}
  std::set<uint32_t> lost_triggers;  // of these no frame comes
  // What is wrong with the frames of these triggers.
  std::map<uint32_t, std::function<void(CapturedFrame&)>> tampered;
  // A picture, by trigger and exposure; none: all of one value.
  std::function<std::string(uint32_t trigger, double exposure_s, size_t bytes)> picture;
  uint32_t repeat_index = 0;
  const std::string& name() const override { return camera_.name; }
  Status Open() override { return log_.Add(camera_.name + " open"); }
  Status Configure(double exposure_s, const Region& region, uint32_t repeat) override {
    MESORIG_RETURN_IF_ERROR(log_.Add(fmt::format("{} exposure {}", camera_.name, exposure_s)));
    repeat_index = repeat;
    exposure_s_ = exposure_s;
    region_ = region;
    return OkStatus();
  }
  Status Trigger(uint32_t trigger_id) override {
    MESORIG_RETURN_IF_ERROR(log_.Add(fmt::format("{} trigger {}", camera_.name, trigger_id)));
    triggered_at_ = clock_.Now();
    return OkStatus();
  }
  StatusOr<CapturedFrame> Await(uint32_t trigger_id, RigTime deadline) override {
    MESORIG_RETURN_IF_ERROR(log_.Add(fmt::format("{} frame {}", camera_.name, trigger_id)));
    const bool lost = lost_triggers.contains(trigger_id);
    const RigTime end = triggered_at_ + FromSeconds(exposure_s_);
    const RigTime delivery = lost ? kNever : end + FromSeconds(camera_.readout_s);
    const Status waited = stop_.Wait(std::min(deadline, delivery), [] { return false; });
    if (absl::IsCancelled(waited)) return waited;
    if (lost)
      return DeadlineExceeded("camera {}: no frame of trigger {}", camera_.name, trigger_id);
    CapturedFrame frame{trigger_id,    ++frames_,      triggered_at_, end,
                        region_.width, region_.height, camera_.bits,  nullptr};
    const auto pixels = static_cast<size_t>(region_.width) * static_cast<size_t>(region_.height);
    frame.pixels = std::make_shared<const std::string>(
        picture ? picture(trigger_id, exposure_s_,
                          pixels * static_cast<size_t>(camera_.bytes_per_pixel()))
                : std::string(pixels * static_cast<size_t>(camera_.bytes_per_pixel()), '\1'));
    if (const auto wrong = tampered.find(trigger_id); wrong != tampered.end()) {
      wrong->second(frame);
    }
    return frame;
  }
  uint64_t dropped_frames() const override { return 0; }

 private:
  RigClock& clock_;
  const StopFlag& stop_;
  OperationLog& log_;
  const mesorig::Camera camera_;
  double exposure_s_ = 0;
  Region region_ = camera_.full_region();
  RigTime triggered_at_{};
  uint64_t frames_ = 0;
};

// An emitter that goes where it is told, at any speed; to its start within prepare_s.
class FakeLaser final : public LineLaser {
 public:
  FakeLaser(RigClock& clock, const StopFlag& stop, OperationLog& log, const Laser& laser)
      : clock_(clock), stop_(stop), log_(log), laser_(laser) {}
  const std::string& name() const override { return laser_.name; }
  Status Open() override { return log_.Add("laser open"); }
  Status MarkZero() override { return log_.Add("laser zero"); }
  Status Prepare(double tilt_rad, double rate_rad_s) override {
    MESORIG_RETURN_IF_ERROR(log_.Add(fmt::format("laser prepare {:.2f}", DegFromRad(tilt_rad))));
    from_rad_ = tilt_rad - 0.1 * rate_rad_s;
    return Sleep(prepare_s);
  }
  StatusOr<double> StartSweep(double rate_rad_s) override {
    MESORIG_RETURN_IF_ERROR(log_.Add("laser sweep"));
    rate_rad_s_ = rate_rad_s;
    started_ = clock_.Now();
    return rate_rad_s;
  }
  Status AwaitTilt(double tilt_rad, RigTime) override {
    MESORIG_RETURN_IF_ERROR(log_.Add("laser there"));
    return Sleep((tilt_rad - from_rad_) / rate_rad_s_);
  }
  StatusOr<LaserReading> Read() override {
    MESORIG_RETURN_IF_ERROR(log_.Add("laser read"));
    return LaserReading{from_rad_ + rate_rad_s_ * Seconds(clock_.Now() - started_), moving(),
                        clock_.Now()};
  }
  Status Stop() override {
    rate_rad_s_ = 0;
    return log_.Add("laser stop");
  }
  Status KeepAlive() override { return OkStatus(); }
  bool moving() const { return rate_rad_s_ != 0; }

  double prepare_s = 0.5;

 private:
  Status Sleep(double seconds) {
    const Status waited = stop_.Wait(clock_.Now() + FromSeconds(seconds), [] { return false; });
    return absl::IsCancelled(waited) ? waited : OkStatus();
  }
  RigClock& clock_;
  const StopFlag& stop_;
  OperationLog& log_;
  const Laser laser_;
  double from_rad_ = 0, rate_rad_s_ = 0;
  RigTime started_{};
};

}  // namespace mesorig::daemon
