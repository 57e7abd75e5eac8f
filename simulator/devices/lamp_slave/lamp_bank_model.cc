#include "simulator/devices/lamp_slave/lamp_bank_model.h"

#include <algorithm>
#include <cmath>

#include "simulator/devices/faults/fault_table.h"

namespace mesorig::simulator {

LampBankModel::LampBankModel(const Rig& rig, Contactor& contactor)
    : timeout_(FromSeconds(rig.lamp_bank.timeout_s)) {
  int channels = 0;
  for (const Lamp& lamp : rig.lamps) {
    channel_of_lamp_.push_back(lamp.channel);
    levels_.emplace_back(lamp.rise_s, lamp.settle_s);
    names_.push_back(lamp.name);
    dead_.push_back(false);
    channels = std::max(channels, lamp.channel + 1);
  }
  coils_.assign(static_cast<size_t>(channels), false);
  contactor.OnChange([this](bool closed, RigTime now) {
    power_ = closed;
    if (!closed) AllOff(now);
  });
}

void LampBankModel::Switch(int channel, bool on, RigTime now) {
  if (on && !power_) return;  // no supply: the coil does not pull in
  coils_[channel] = on;
  for (size_t i = 0; i < levels_.size(); ++i) {
    if (channel_of_lamp_[i] == channel) levels_[i].Set(on && !dead_[i] ? 1 : 0, Seconds(now));
  }
}

void LampBankModel::AllOff(RigTime now) {
  for (int channel = 0; channel < channel_count(); ++channel) Switch(channel, false, now);
}

uint16_t LampBankModel::FluxPerMille(int channel, RigTime now) const {
  for (size_t i = 0; i < levels_.size(); ++i) {
    if (channel_of_lamp_[i] == channel) {
      return static_cast<uint16_t>(std::lround(1000 * levels_[i].At(Seconds(now))));
    }
  }
  return 0;
}

std::vector<double> LampBankModel::MeanLevels(RigTime from, RigTime to) const {
  std::vector<double> levels;
  for (const auto& level : levels_) levels.push_back(level.Mean(Seconds(from), Seconds(to)));
  return levels;
}

std::vector<double> LampBankModel::CommandedLevels() const {
  std::vector<double> levels;
  for (const auto& level : levels_) levels.push_back(level.commanded());
  return levels;
}

void LampBankModel::Command(RigTime, std::string_view, sim_wire::Outbox&) {}

StatusOr<std::string> LampBankModel::Query(RigTime, std::string_view, sim_wire::Outbox&) {
  return InvalidArgument("the lamp bank speaks Modbus TCP");
}

Status LampBankModel::Inject(RigTime now, std::string_view text, sim_wire::Outbox&) {
  const auto words = FaultWords(text);
  const bool dead = words.size() == 2 && words[0] == "dead";
  if (dead || (words.size() == 2 && words[0] == "alive")) return SetDead(words[1], dead, now);
  if (!words.empty() && words.size() <= 2 && words[0] == "exception") {
    return Annotate(FaultNumber(words, 1, 0, 1'000'000, 1u, exceptions_), "lamps");
  }
  if (text == "close") {
    if (on_close_) on_close_();
    return OkStatus();
  }
  return InvalidArgument("lamps: \"{}\" is not one of: dead LAMP, alive LAMP, exception [N], close",
                         text);
}

Status LampBankModel::SetDead(std::string_view lamp, bool dead, RigTime now) {
  const auto found = std::find(names_.begin(), names_.end(), lamp);
  if (found == names_.end()) return NotFound("lamps: there is no lamp \"{}\"", lamp);
  const auto i = static_cast<size_t>(found - names_.begin());
  dead_[i] = dead;
  if (dead) levels_[i].Set(0, Seconds(now));  // a new bulb shines when it is switched on next
  return OkStatus();
}

void LampBankModel::RunEvent(RigTime now, sim_wire::Outbox&) {
  deadline_ = kNever;  // until the next request
  AllOff(now);
}

}  // namespace mesorig::simulator
