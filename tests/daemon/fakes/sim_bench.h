#pragma once
// The sequencer with real drivers on the simulator's devices, in one process and in lockstep.

#include <memory>
#include <utility>
#include <vector>

#include "daemon/control/sequencer.h"
#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {

// The small rig, or another one.
class SimBench {
 public:
  explicit SimBench(std::vector<sim_wire::TimedInjection> script = {}, Rig description = SmallRig())
      : rig(std::move(description)), sim(rig, std::move(script)) {
    for (size_t i = 0; i < rig.axes.size(); ++i) {
      axes_.push_back(MakeAxis("cia402", end.context, static_cast<int>(i)).value());
      devices_.axes.push_back(axes_.back().get());
    }
    for (size_t i = 0; i < rig.cameras.size(); ++i) {
      cameras_.push_back(MakeCamera("sim_camera", end.context, static_cast<int>(i)).value());
      devices_.cameras.push_back(cameras_.back().get());
    }
    lamps_ = MakeLampBank("modbus_lamps", end.context).value();
    lines_ = MakeDigitalLines("gpio_lines", end.context).value();
    devices_.lamps = lamps_.get();
    devices_.lines = lines_.get();
    if (rig.laser) {
      laser_ = MakeLineLaser("nxt_laser", end.context).value();
      devices_.laser = laser_.get();
    }
    devices_.stop = &end.stop;
    sequencer =
        Sequencer::Create(*end.link, rig, devices_, [this] { return end.link->deterministic(); });
  }

  const Rig rig;
  SimRig sim;
  RigEnd end{sim, rig};

 private:
  Devices devices_;
  std::vector<std::unique_ptr<Axis>> axes_;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::unique_ptr<LampBank> lamps_;
  std::unique_ptr<DigitalLines> lines_;
  std::unique_ptr<LineLaser> laser_;  // of a rig with one

 public:
  std::unique_ptr<Sequencer> sequencer;  // last: it uses all of them
};

}  // namespace mesorig::daemon
