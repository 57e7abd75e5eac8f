#pragma once
// The rig's lamps behind a Modbus dimmer bank.

#include <vector>

#include "daemon/bus/modbus_bus.h"
#include "daemon/device/lamp_bank.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon::modbus_lamps {

// Borrows the bus. Switches all lamps off when it is destroyed.
class ModbusLamps final : public LampBank {
 public:
  ModbusLamps(ModbusBus& bus, const Rig& rig);
  ~ModbusLamps() override;
  Status Open() override;
  Status SwitchTo(int channel) override;
  StatusOr<std::vector<double>> ReadLevels() override;
  StatusOr<LampReadings> Watch() override;
  Status AllOff() override;

 private:
  StatusOr<std::vector<double>> Levels(const std::vector<uint16_t>& registers) const;
  ModbusBus& bus_;
  const bool measures_heat_;
  std::vector<int> channel_of_lamp_;  // in the order of Rig::lamps
  int channels_ = 0;                  // coils and registers 0..channels_-1
};

}  // namespace mesorig::daemon::modbus_lamps
