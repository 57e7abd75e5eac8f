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
    stuck_.push_back(false);
    housings_.emplace_back();
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
    if (channel_of_lamp_[i] == channel) SetLit(i, on, now);
  }
}

// A relay that sticks holds what the contactor still feeds.
void LampBankModel::SetLit(size_t lamp, bool lit, RigTime now) {
  if (stuck_[lamp] && power_) return;
  const double level = lit && !dead_[lamp] ? 1 : 0;
  if (on_power_ && level != levels_[lamp].commanded()) on_power_(lamp, level > 0, now);
  levels_[lamp].Set(level, Seconds(now));
  housings_[lamp].Set(level, Seconds(now));
}

uint16_t LampBankModel::HousingTenths(int channel, RigTime now) const {
  for (size_t i = 0; i < housings_.size(); ++i) {
    if (channel_of_lamp_[i] != channel) continue;
    const double tenths = std::round(10 * housings_[i].At(Seconds(now)));
    return static_cast<uint16_t>(std::clamp(tenths, 0.0, 65535.0));
  }
  return 0;
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
  if (words.size() == 2 && (words[0] == "dead" || words[0] == "alive" || words[0] == "stuck")) {
    MESORIG_ASSIGN_OR_RETURN(const size_t lamp, Find(words[1]));
    if (words[0] == "stuck") {
      stuck_[lamp] = true;
    } else {
      SetDead(lamp, words[0] == "dead", now);
    }
    return OkStatus();
  }
  if (words.size() == 3 && words[0] == "heat") {
    MESORIG_ASSIGN_OR_RETURN(const size_t lamp, Find(words[1]));
    double celsius = 0;
    MESORIG_RETURN_IF_ERROR(Annotate(FaultReal(words, 2, 0, 2000, celsius), "lamps"));
    housings_[lamp].Heat(celsius, Seconds(now));
    return OkStatus();
  }
  if (!words.empty() && words.size() <= 2 && words[0] == "exception") {
    return Annotate(FaultNumber(words, 1, 0, 1'000'000, 1u, exceptions_), "lamps");
  }
  if (text == "close") {
    if (on_close_) on_close_();
    return OkStatus();
  }
  return InvalidArgument("lamps: \"{}\" is not one of: dead LAMP, alive LAMP, heat LAMP DEGREES, stuck LAMP, "
                         "exception [N], close",
                         text);
}

StatusOr<size_t> LampBankModel::Find(std::string_view lamp) const {
  const auto found = std::find(names_.begin(), names_.end(), lamp);
  if (found == names_.end()) return NotFound("lamps: there is no lamp \"{}\"", lamp);
  return static_cast<size_t>(found - names_.begin());
}

void LampBankModel::SetDead(size_t lamp, bool dead, RigTime now) {
  if (dead) {
    stuck_[lamp] = false;
    SetLit(lamp, false, now);
  }
  if (!dead) stuck_[lamp] = false;  // a new bulb shines when it is switched on next
  dead_[lamp] = dead;
}

void LampBankModel::RunEvent(RigTime now, sim_wire::Outbox&) {
  deadline_ = kNever;  // until the next request
  AllOff(now);
}

}  // namespace mesorig::simulator
