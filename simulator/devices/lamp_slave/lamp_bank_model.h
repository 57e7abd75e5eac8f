#pragma once
// The lamps behind the bank, in virtual time: what was commanded, what shines. As a SimDevice it
// has one event of its own, the communication-loss timeout. Called by the dispatcher only, or
// inside SimServer::RunExclusive.

#include <span>
#include <string>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/contactor.h"
#include "simulator/plant/lamp_level.h"

namespace mesorig::simulator {

class LampBankModel final : public sim_wire::SimDevice {
 public:
  LampBankModel(const Rig& rig, Contactor& contactor);

  // The Modbus side. A channel without a lamp can be switched and stays dark.
  int channel_count() const { return static_cast<int>(coils_.size()); }
  void Switch(int channel, bool on, RigTime now);
  bool Coil(int channel) const { return coils_[channel]; }
  uint16_t FluxPerMille(int channel, RigTime now) const;
  void RequestSeen(RigTime now) { deadline_ = now + timeout_; }

  // The world's side, per Rig::lamps. from <= to: mean over an exposure.
  std::vector<double> MeanLevels(RigTime from, RigTime to) const;
  std::vector<double> CommandedLevels() const;

  std::string name() const override { return std::string(sim_wire::kLampsDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override { return deadline_; }
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;

 private:
  void AllOff(RigTime now);
  RigTime timeout_, deadline_ = kNever;
  bool power_ = true;
  std::vector<int> channel_of_lamp_;
  std::vector<bool> coils_;
  std::vector<plant::LampLevel> levels_;  // per lamp
};

}  // namespace mesorig::simulator
