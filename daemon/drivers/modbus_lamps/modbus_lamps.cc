#include "daemon/drivers/modbus_lamps/modbus_lamps.h"

#include <algorithm>

#include "daemon/drivers/driver.h"
#include "protocol/base/log.h"

namespace mesorig::daemon::modbus_lamps {
namespace {

constexpr double kFullFlux = 1000;       // register value
constexpr double kTenthsOfADegree = 10;  // likewise, Celsius
constexpr uint16_t kLargestFlux = 2000;  // a new lamp is a little over its rating; more is no flux

}  // namespace

ModbusLamps::ModbusLamps(ModbusBus& bus, const Rig& rig)
    : bus_(bus), measures_heat_(rig.lamp_bank.housing_temperatures) {
  for (const Lamp& lamp : rig.lamps) {
    channel_of_lamp_.push_back(lamp.channel);
    channels_ = std::max(channels_, lamp.channel + 1);
  }
}

ModbusLamps::~ModbusLamps() {
  if (const Status status = AllOff(); !status.ok()) Log("drivers").error("{}", Message(status));
}

Status ModbusLamps::Open() {
  MESORIG_RETURN_IF_ERROR(ReadLevels().status());
  if (!measures_heat_ || channels_ == 0) return OkStatus();
  const auto registers = bus_.ReadInputRegisters(channels_, channels_);
  return Annotate(registers.status(), "lamp bank: temperatures of the housings "
                                      "(lamp_bank.housing_temperatures)");
}

Status ModbusLamps::SwitchTo(int channel) {
  if (channel < -1 || channel >= channels_) {
    return InvalidArgument("lamp bank: channel {} is not in [-1, {}]", channel, channels_ - 1);
  }
  if (channels_ == 0) return OkStatus();
  std::vector<uint8_t> coils(channels_, 0);
  if (channel >= 0) coils[channel] = 1;
  return Annotate(bus_.WriteCoils(0, std::move(coils)), "lamp bank");
}

StatusOr<std::vector<double>> ModbusLamps::ReadLevels() {
  if (channels_ == 0) return std::vector<double>();
  const auto registers = bus_.ReadInputRegisters(0, channels_);
  if (!registers.ok()) return Annotate(registers.status(), "lamp bank");
  return Levels(*registers);
}

StatusOr<std::vector<double>> ModbusLamps::Levels(const std::vector<uint16_t>& registers) const {
  std::vector<double> levels;
  for (const int channel : channel_of_lamp_) {
    const uint16_t flux = registers[channel];
    if (flux > kLargestFlux) {
      return Unavailable("lamp bank: channel {} reads {} per mille, which is not in [0, {}]",
                         channel, flux, kLargestFlux);
    }
    levels.push_back(flux / kFullFlux);
  }
  return levels;
}

StatusOr<LampReadings> ModbusLamps::Watch() {
  LampReadings readings;
  if (channels_ == 0) return readings;
  const auto registers = bus_.LookAtInputRegisters(0, measures_heat_ ? 2 * channels_ : channels_);
  if (!registers.ok()) return Annotate(registers.status(), "lamp bank");
  MESORIG_ASSIGN_OR_RETURN(readings.levels, Levels(*registers));
  if (!measures_heat_) return readings;
  for (const int channel : channel_of_lamp_) {
    readings.housing_c.push_back((*registers)[channels_ + channel] / kTenthsOfADegree);
  }
  return readings;
}

Status ModbusLamps::AllOff() {
  if (channels_ == 0) return OkStatus();
  return Annotate(bus_.WriteCoilsAtOnce(0, std::vector<uint8_t>(channels_, 0)), "lamp bank");
}

Driver Describe() {
  Driver driver;
  driver.make_lamp_bank =
      [](const DriverContext& context) -> StatusOr<std::unique_ptr<daemon::LampBank>> {
    if (context.modbus == nullptr) {
      return FailedPrecondition(
          "lamp bank: driver modbus_lamps needs a Modbus connection, and there is none");
    }
    return std::make_unique<ModbusLamps>(*context.modbus, *context.rig);
  };
  return driver;
}

}  // namespace mesorig::daemon::modbus_lamps
