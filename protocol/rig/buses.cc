#include "protocol/rig/buses.h"

#include <absl/strings/numbers.h>

#include <algorithm>

#include "protocol/rig/rig.h"

namespace mesorig {
namespace {

constexpr size_t kLongestInterface = 15;  // IFNAMSIZ less its zero
constexpr size_t kLongestName = 31;       // GPIO_MAX_NAME_SIZE likewise
constexpr size_t kLongestPath = 80;       // with what a claim's name has besides (device_claim.h)

// A word that can be handed to the kernel: printable, without spaces.
std::string ReadName(TomlTable& t, std::string_view key, size_t longest) {
  std::string name = t.String(key);
  const bool printable =
      std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c < '\x7F'; });
  if (name.empty() || name.size() > longest || !printable) {
    t.Error(key, fmt::format("must be 1 to {} printable characters without spaces", longest));
  }
  return name;
}

Buses::Can ReadCan(TomlTable t) {
  Buses::Can can;
  can.interface = ReadName(t, "interface", kLongestInterface);
  if (can.interface.find('/') != std::string::npos) t.Error("interface", "has a slash");
  if (t.Has("bitrate")) can.bitrate = static_cast<int>(t.Integer("bitrate", {10'000, 1'000'000}));
  return can;
}

Buses::Gpio ReadGpio(TomlTable t, const Lines& lines) {
  Buses::Gpio gpio;
  gpio.chip = ReadName(t, "chip", kLongestName);
  auto names = t.TableIfPresent("names");
  if (!names) return gpio;
  const std::pair<std::string_view, int> all[] = {
      {"estop", lines.estop},       {"door", lines.door},
      {"reset", lines.reset},       {"laser_trigger", lines.laser_trigger},
      {"laser_on", lines.laser_on}, {"power", lines.power}};
  for (const auto& [key, number] : all) {
    if (!names->Has(key)) continue;
    std::string name = ReadName(*names, key, kLongestName);
    if (number < 0) names->Error(key, "is no line of this rig's [lines]");
    const auto same = std::find_if(gpio.names.begin(), gpio.names.end(),
                                   [&](const auto& other) { return other.second == name; });
    if (same != gpio.names.end()) names->Error(key, fmt::format("is `{}`, which is used twice", name));
    gpio.names.emplace(number, std::move(name));
  }
  return gpio;
}

Buses::Modbus ReadModbus(TomlTable t) {
  Buses::Modbus modbus;
  if (t.Has("rtu") == t.Has("tcp")) {
    t.Error("", "needs one of `rtu` (a serial line's device) and `tcp` (HOST:PORT)");
    return modbus;
  }
  if (t.Has("tcp")) {
    modbus.tcp = ReadName(t, "tcp", kLongestPath);
    const size_t colon = std::min(modbus.tcp.rfind(':'), modbus.tcp.size());
    const std::string_view digits = std::string_view(modbus.tcp).substr(std::min(colon + 1, modbus.tcp.size()));
    int port = 0;
    if (colon == 0 || !absl::SimpleAtoi(std::string(digits), &port) || port < 1 || port > 65535) {
      t.Error("tcp", fmt::format("is `{}`, not HOST:PORT with a port in [1, 65535]", modbus.tcp));
    }
    return modbus;
  }
  modbus.rtu = ReadName(t, "rtu", kLongestPath);
  if (!modbus.rtu.starts_with('/')) t.Error("rtu", "must be an absolute path, as /dev/ttyUSB0");
  modbus.baud = static_cast<int>(t.IntegerOr("baud", 19200, {1200, 115200}));
  constexpr int kRates[] = {1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200};
  if (std::find(std::begin(kRates), std::end(kRates), modbus.baud) == std::end(kRates)) {
    t.Error("baud", "permitted is 1200, 2400, 4800, 9600, 19200, 38400, 57600 or 115200");
  }
  const std::string parity =
      t.Has("parity") ? t.Word("parity", {"even", "odd", "none"}) : std::string("even");
  modbus.parity = parity == "none" ? 'N' : parity == "odd" ? 'O' : 'E';
  // A character has eleven bits either way.
  modbus.stop_bits =
      static_cast<int>(t.IntegerOr("stop_bits", modbus.parity == 'N' ? 2 : 1, {1, 2}));
  return modbus;
}

}  // namespace

Buses ReadBuses(TomlTable table, const Lines& lines) {
  Buses buses;
  if (const auto can = table.TableIfPresent("can")) buses.can = ReadCan(*can);
  if (const auto gpio = table.TableIfPresent("gpio")) buses.gpio = ReadGpio(*gpio, lines);
  if (const auto modbus = table.TableIfPresent("modbus")) buses.modbus = ReadModbus(*modbus);
  if (auto usb = table.TableIfPresent("usb")) buses.usb = Buses::Usb{ReadName(*usb, "serial", 64)};
  return buses;
}

}  // namespace mesorig
