#pragma once
// The kernel's interfaces that a rig's buses are behind: [buses] of a rig file (rigs/README.md). A bus
// that is not named there is the simulator's stand-in. Values; nothing here opens anything.

#include <map>
#include <optional>
#include <string>

#include "protocol/base/toml_reader.h"

namespace mesorig {

struct Lines;

struct Buses {
  struct Can {
    std::string interface;  // "can0"
    int bitrate = 0;        // bit/s that the system gives it; 0: not said (a virtual one has none)
  };
  struct Gpio {
    std::string chip;                 // "gpiochip0", or its label
    std::map<int, std::string> names;  // line number of [lines] to the kernel's name of that line
  };
  // Modbus RTU over a serial line, 8 data bits (Modbus over serial line V1.02, 2.5.1), or TCP.
  struct Modbus {
    std::string rtu;  // "/dev/ttyUSB0"; empty: TCP
    int baud = 19200;
    char parity = 'E';  // 'E', 'O' or 'N'
    int stop_bits = 1;  // 1 or 2
    std::string tcp;    // "192.168.1.20:502", a numeric host; empty: RTU
    // As messages name it: "rtu:/dev/ttyUSB0", "tcp:192.168.1.20:502".
    std::string endpoint() const { return rtu.empty() ? "tcp:" + tcp : "rtu:" + rtu; }
  };
  struct Usb {
    std::string serial;  // of the laser unit's brick
  };
  std::optional<Can> can;
  std::optional<Gpio> gpio;
  std::optional<Modbus> modbus;
  std::optional<Usb> usb;
  bool any() const { return can || gpio || modbus || usb; }
};

// The table [buses]; errors are the table's. `lines`: those that names may be given to.
Buses ReadBuses(TomlTable table, const Lines& lines);

}  // namespace mesorig
