#pragma once
// The lamps behind the bank, in virtual time: what was commanded, what shines. As a SimDevice it
// has one event of its own, the communication-loss timeout. Called by the dispatcher only, or
// inside SimServer::RunExclusive. By the back-channel: dead LAMP, alive LAMP, heat LAMP DEGREES, stuck
// LAMP, exception [N], close.

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "protocol/rig/rig.h"
#include "protocol/sim_wire/payloads.h"
#include "protocol/sim_wire/sim_server.h"
#include "simulator/devices/contactor.h"
#include "simulator/plant/lamp_housing.h"
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
  uint16_t HousingTenths(int channel, RigTime now) const;  // of a degree Celsius; 0: no lamp
  void RequestSeen(RigTime now) { deadline_ = now + timeout_; }
  // Whether this request is to be refused.
  bool TakeException() { return exceptions_ > 0 && exceptions_-- > 0; }
  // Told when somebody at the bank closes its connections (a plug that stays in), and when its plug
  // goes out or in.
  void OnClose(std::function<void()> f) { on_close_ = std::move(f); }
  void OnPlug(std::function<void(bool plugged)> f) { on_plug_ = std::move(f); }

  // Told when a lamp (index into Rig::lamps) is given power, or not any more.
  void OnPower(std::function<void(size_t lamp, bool on, RigTime)> f) { on_power_ = std::move(f); }

  // The world's side, per Rig::lamps. from <= to: mean over an exposure.
  std::vector<double> MeanLevels(RigTime from, RigTime to) const;
  std::vector<double> CommandedLevels() const;

  std::string name() const override { return std::string(sim_wire::kLampsDevice); }
  void Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) override;
  StatusOr<std::string> Query(RigTime now, std::string_view payload,
                              sim_wire::Outbox& out) override;
  RigTime NextEvent() const override { return deadline_; }
  void RunEvent(RigTime now, sim_wire::Outbox& out) override;
  Status Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) override;
  void Plug(RigTime, bool plugged, sim_wire::Outbox&) override {
    if (on_plug_) on_plug_(plugged);
  }

 private:
  StatusOr<size_t> Find(std::string_view lamp) const;
  void SetDead(size_t lamp, bool dead, RigTime now);
  void SetLit(size_t lamp, bool lit, RigTime now);
  void AllOff(RigTime now);
  RigTime timeout_, deadline_ = kNever;
  bool power_ = true;
  std::vector<int> channel_of_lamp_;
  std::vector<bool> coils_;
  std::vector<plant::LampLevel> levels_;  // per lamp
  std::vector<std::string> names_;        // likewise
  std::vector<plant::LampHousing> housings_;
  std::vector<bool> dead_, stuck_;        // likewise: the filament is broken; the relay sticks
  std::function<void(size_t, bool, RigTime)> on_power_;
  uint32_t exceptions_ = 0;
  std::function<void()> on_close_;
  std::function<void(bool)> on_plug_;
};

}  // namespace mesorig::simulator
