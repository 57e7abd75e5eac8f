#pragma once
// The simulator's devices in a thread of this process, and the daemon's end of them in lockstep:
// what a driver or the sequencer meets in `mesorigd`, less the pictures.

#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/bus/sim_can_port.h"
#include "daemon/bus/sim_line_port.h"
#include "daemon/bus/sim_usb_port.h"
#include "daemon/drivers/driver.h"
#include "protocol/sim_wire/sim_link.h"
#include "simulator/devices/camera/camera_device.h"
#include "simulator/devices/cia402_node/can_bus.h"
#include "simulator/devices/digital_lines/digital_lines.h"
#include "simulator/devices/faults/faulty_device.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"
#include "simulator/devices/lamp_slave/lamp_slave.h"
#include "simulator/devices/laser_unit/laser_unit.h"
#include "simulator/devices/nxt_brick/nxt_brick.h"

namespace mesorig::daemon {

// The CAN bus with somebody at its wires. Settings are made while time stands still.
class MeddledCan final : public sim_wire::SimDevice {
 public:
  MeddledCan(const Rig& rig, simulator::Contactor& contactor) : bus_(rig, 7, contactor) {}
  std::atomic<bool> mute{false};         // nothing of what the daemon says arrives
  std::atomic<uint16_t> abort_index{0};  // SDO writes of this object are aborted with abort_code
  std::atomic<uint32_t> abort_code{0};
  std::atomic<uint16_t> deaf_index{0};    // SDO writes of this object are answered and not heard
  std::atomic<int32_t> target_offset{0};  // counts, added to each set-point on its way
  std::atomic<int> commands{0};

  std::string name() const override { return bus_.name(); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override {
    ++commands;
    if (mute) return;
    auto frame = sim_wire::UnpackCanFrame(payload).value();
    if ((frame.id & 0x780) == 0x400 && target_offset != 0) {
      uint32_t target = 0;
      for (int i = 0; i < 4; ++i) target |= uint32_t{frame.data[2 + i]} << (8 * i);
      target += static_cast<uint32_t>(target_offset.load());
      for (int i = 0; i < 4; ++i) frame.data[2 + i] = static_cast<uint8_t>(target >> (8 * i));
      return bus_.Command(now, sim_wire::Pack(frame), out);
    }
    const auto index = static_cast<uint16_t>(frame.data[1] | frame.data[2] << 8);
    const bool writes = (frame.id & 0x780) == 0x600 && frame.data[0] != 0x40;
    if (writes && deaf_index != 0 && index == deaf_index) {
      sim_wire::CanFrame reply{static_cast<uint16_t>(frame.id - 0x80), 8, frame.data};
      reply.data[0] = 0x60;
      out.Send(sim_wire::Pack(reply));
      return;
    }
    if (writes && index == abort_index) {
      sim_wire::CanFrame reply{static_cast<uint16_t>(frame.id - 0x80), 8, frame.data};
      reply.data[0] = 0x80;
      for (int i = 0; i < 4; ++i) reply.data[4 + i] = static_cast<uint8_t>(abort_code >> (8 * i));
      out.Send(sim_wire::Pack(reply));
      return;
    }
    bus_.Command(now, payload, out);
  }
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override {
    return bus_.Query(now, payload, out);
  }
  RigTime NextEvent() const override { return bus_.NextEvent(); }
  void RunEvent(RigTime now, sim_wire::Outbox& out) override { bus_.RunEvent(now, out); }
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override {
    return bus_.Inject(now, text, out);
  }
  const simulator::Cia402Node& node(size_t axis) const { return bus_.node(axis); }
  void OnTorque(const std::function<void(size_t axis, bool on, RigTime)>& f) { bus_.OnTorque(f); }

 private:
  simulator::CanBusDevice bus_;
};

// Does something to the rig at an instant of virtual time.
class TimedHand final : public sim_wire::SimDevice {
 public:
  std::string name() const override { return "hand"; }
  // Before time moves.
  void At(RigTime when, std::function<void(RigTime)> what) {
    when_ = when;
    what_ = std::move(what);
  }
  void Command(RigTime, std::string_view, sim_wire::Outbox&) override {}
  StatusOr<std::string> Query(RigTime, std::string_view, sim_wire::Outbox&) override {
    return InvalidArgument("a hand answers nothing");
  }
  RigTime NextEvent() const override { return when_; }
  void RunEvent(RigTime now, sim_wire::Outbox&) override {
    when_ = kNever;
    what_(now);
  }

 private:
  RigTime when_ = kNever;
  std::function<void(RigTime)> what_;
};

// Light that depends on where the axes stand and what shines.
class AngleSource final : public simulator::ImageSource {
 public:
  // laser: null in a rig without one.
  AngleSource(const Rig& rig, const MeddledCan& can, const simulator::LampBankModel& lamps,
              const simulator::LaserUnit* laser)
      : rig_(rig), can_(can), lamps_(lamps), laser_(laser) {}
  Scene Observe(RigTime from, RigTime to) override {
    Scene scene;
    for (size_t i = 0; i < rig_.axes.size(); ++i) {
      const double counts = can_.node(i).WorldCounts(to);
      scene.axis_rad.push_back(counts / rig_.axes[i].counts_per_turn * 2 * kPi);
      scene.key.axis_counts.push_back(std::llround(counts));
    }
    scene.lamp_level = lamps_.MeanLevels(from, to);
    scene.key.lamp_levels = lamps_.CommandedLevels();
    scene.key.seed = 7;
    if (laser_ != nullptr) {
      scene.laser_mount = laser_->mount();
      scene.key.laser_level = scene.laser_level = laser_->MeanLevel(from, to);
    }
    return scene;
  }
  StatusOr<std::vector<float>> ExpectedElectrons(int, const Scene& scene,
                                                 double exposure_s) override {
    double light = 0;
    for (const double level : scene.lamp_level) light += level;
    light += 0.3 * scene.laser_level * (1 + scene.laser_mount);
    const double electrons = exposure_s * 1e5 * light * (2 + std::sin(scene.axis_rad[0]));
    return std::vector<float>(static_cast<size_t>(scene.region.width) * scene.region.height,
                              static_cast<float>(electrons));
  }

 private:
  const Rig& rig_;
  const MeddledCan& can_;
  const simulator::LampBankModel& lamps_;
  const simulator::LaserUnit* const laser_;
};

// The simulator's end.
class SimRig {
 public:
  // script: faults at instants of virtual time.
  explicit SimRig(const Rig& rig, std::vector<sim_wire::TimedInjection> script = {})
      : can(rig, contactor),
        lamps(rig, contactor),
        laser(rig.laser ? std::make_unique<simulator::LaserUnit>(rig, 7, contactor) : nullptr),
        lines(rig.lines, contactor, laser.get()),
        source_(rig, can, lamps, laser.get()) {
    static std::atomic<int> count{0};
    dir_ = std::filesystem::temp_directory_path() /
           fmt::format("mesorig-sim-rig-{}-{}", ::getpid(), count++);
    std::filesystem::create_directories(dir_);
    for (size_t i = 0; i < rig.cameras.size(); ++i) {
      cameras_.push_back(
          std::make_unique<simulator::CameraDevice>(rig, static_cast<int>(i), source_));
    }
    std::vector<sim_wire::SimDevice*> devices{&hand, &lines, &lamps, &can};
    for (const auto& camera : cameras_) devices.push_back(camera.get());
    if (laser) {
      brick_ = std::make_unique<simulator::NxtBrick>(rig, *laser);
      devices.push_back(brick_.get());
    }
    faulty_ = std::make_unique<simulator::FaultyDevices>(devices);
    slave_ = simulator::LampSlave::Listen(lamps, rig.lamp_bank.unit, faulty_->Find("lamps")).value();
    sim_wire::SimServerOptions options;
    options.script = std::move(script);
    options.welcome.modbus_endpoint = slave_->endpoint();
    server_ = std::make_unique<sim_wire::SimServer>(sim_wire::Listen(dir_ / "s").value(),
                                                    faulty_->All(), options);
    slave_->Start(*server_);
    thread_ = std::thread([this] { (void)server_->Run(); });
  }
  ~SimRig() {
    slave_.reset();
    server_->Stop();
    thread_.join();
    std::filesystem::remove_all(dir_);
  }
  std::string endpoint() const { return "unix:" + (dir_ / "s").string(); }
  // Looks at or changes the world at the present instant.
  void Exclusive(const std::function<void(RigTime)>& f) { server_->RunExclusive(f); }
  // A fault now (simulator/devices/faults/fault_table.h), as from the back-channel.
  Status Inject(const std::string& text) { return server_->InjectNow(text); }

  simulator::Contactor contactor;
  TimedHand hand;
  MeddledCan can;
  simulator::LampBankModel lamps;
  std::unique_ptr<simulator::LaserUnit> laser;  // in a rig with one
  simulator::DigitalLinesDevice lines;

 private:
  std::unique_ptr<simulator::NxtBrick> brick_;  // likewise
  AngleSource source_;
  std::vector<std::unique_ptr<simulator::CameraDevice>> cameras_;
  std::unique_ptr<simulator::FaultyDevices> faulty_;
  std::unique_ptr<simulator::LampSlave> slave_;
  std::unique_ptr<sim_wire::SimServer> server_;
  std::filesystem::path dir_;
  std::thread thread_;
};

// The daemon's end: link, buses, and a context to make devices of.
class RigEnd {
 public:
  RigEnd(const SimRig& sim, const Rig& rig)
      : link(sim_wire::SimLink::Connect(sim.endpoint()).value()), stop(*link) {
    can_port_ = SimCanPort::Open(*link).value();
    line_port_ = SimLinePort::Open(*link).value();
    CanBusOptions can_options;
    can_options.heartbeat = FromSeconds(rig.heartbeat_s);
    can = std::make_unique<CanBus>(*link, *can_port_, can_options);
    ModbusBusOptions modbus_options;
    modbus_options.unit = rig.lamp_bank.unit;
    modbus_options.response_timeout = std::chrono::milliseconds(300);  // a lost answer costs that
    modbus_options.keep_alive = FromSeconds(rig.lamp_bank.timeout_s / 3);
    modbus = ModbusBus::Connect(*link, link->welcome().modbus_endpoint, modbus_options).value();
    context.clock = link.get();
    context.rig = &rig;
    context.stop = &stop;
    context.can = can.get();
    context.modbus = modbus.get();
    context.lines = line_port_.get();
    context.simulator = link.get();
    if (rig.laser) {
      usb_port_ = SimUsbPort::Open(*link).value();
      context.usb = usb_port_.get();
    }
  }

  std::unique_ptr<sim_wire::SimLink> link;
  StopFlag stop;

 private:
  std::unique_ptr<SimCanPort> can_port_;
  std::unique_ptr<SimLinePort> line_port_;
  std::unique_ptr<SimUsbPort> usb_port_;

 public:
  std::unique_ptr<CanBus> can;
  std::unique_ptr<ModbusBus> modbus;
  DriverContext context;
};

}  // namespace mesorig::daemon
