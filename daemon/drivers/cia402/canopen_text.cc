#include <fmt/core.h>

#include "daemon/drivers/cia402/objects.h"

namespace mesorig::daemon::cia402 {
namespace {

struct Meaning {
  uint32_t code;
  std::string_view text;
};

constexpr Meaning kAborts[] = {
    {0x05030000, "toggle bit not alternated"},
    {0x05040000, "SDO protocol timed out"},
    {0x05040001, "command specifier not valid"},
    {0x05040005, "out of memory"},
    {0x06010000, "unsupported access to an object"},
    {0x06010001, "read of a write-only object"},
    {0x06010002, "write of a read-only object"},
    {0x06020000, "object does not exist"},
    {0x06040041, "object cannot be mapped to the PDO"},
    {0x06040042, "mapped objects exceed the PDO length"},
    {0x06040043, "general parameter incompatibility"},
    {0x06060000, "access failed due to a hardware error"},
    {0x06070010, "length of service parameter does not match"},
    {0x06070012, "length of service parameter too high"},
    {0x06070013, "length of service parameter too low"},
    {0x06090011, "sub-index does not exist"},
    {0x06090030, "value out of range"},
    {0x06090031, "value too high"},
    {0x06090032, "value too low"},
    {0x08000000, "general error"},
    {0x08000020, "data cannot be stored"},
    {0x08000021, "data cannot be stored because of local control"},
    {0x08000022, "data cannot be stored in the present device state"},
};

// Exact codes before classes; of the classes (last byte or last two zero) the longest match wins.
constexpr Meaning kEmergencies[] = {
    {0x3130, "mains voltage: phase failure"},
    {0x3210, "DC link over-voltage"},
    {0x3220, "DC link under-voltage"},
    {0x4310, "excess temperature of the drive"},
    {0x7121, "motor blocked"},
    {0x7305, "incremental encoder"},
    {0x8110, "CAN overrun"},
    {0x8120, "CAN in error passive mode"},
    {0x8130, "heartbeat lost"},
    {0x8140, "recovered from bus off"},
    {0x8611, "following error"},
    {0x8612, "reference limit"},
    {0x0000, "error reset or no error"},
    {0x2300, "current at the device's output"},
    {0x3100, "mains voltage"},
    {0x3200, "DC link voltage"},
    {0x4200, "ambient temperature"},
    {0x4300, "temperature of the drive"},
    {0x7100, "power part"},
    {0x7300, "sensor"},
    {0x8100, "communication"},
    {0x8600, "positioning controller"},
    {0x1000, "generic error"},
    {0x2000, "current"},
    {0x3000, "voltage"},
    {0x4000, "temperature"},
    {0x5000, "device hardware"},
    {0x6000, "device software"},
    {0x7000, "additional modules"},
    {0x8000, "monitoring"},
    {0x9000, "external error"},
};

}  // namespace

DriveState StateOf(uint16_t statusword) {
  switch (statusword & 0x4F) {
    case 0x00:
      return DriveState::kNotReadyToSwitchOn;
    case 0x40:
      return DriveState::kSwitchOnDisabled;
    case 0x0F:
      return DriveState::kFaultReactionActive;
    case 0x08:
      return DriveState::kFault;
    default:
      break;
  }
  switch (statusword & 0x6F) {
    case 0x21:
      return DriveState::kReadyToSwitchOn;
    case 0x23:
      return DriveState::kSwitchedOn;
    case 0x27:
      return DriveState::kOperationEnabled;
    case 0x07:
      return DriveState::kQuickStopActive;
    default:
      return DriveState::kNotReadyToSwitchOn;  // no state of the table
  }
}

std::string_view Text(DriveState state) {
  switch (state) {
    case DriveState::kNotReadyToSwitchOn:
      return "not ready to switch on";
    case DriveState::kSwitchOnDisabled:
      return "switch on disabled";
    case DriveState::kReadyToSwitchOn:
      return "ready to switch on";
    case DriveState::kSwitchedOn:
      return "switched on";
    case DriveState::kOperationEnabled:
      return "operation enabled";
    case DriveState::kQuickStopActive:
      return "quick stop active";
    case DriveState::kFaultReactionActive:
      return "fault reaction active";
    case DriveState::kFault:
      return "fault";
  }
  return "";
}

std::string SdoAbortText(uint32_t code) {
  for (const Meaning& abort : kAborts) {
    if (abort.code == code) return fmt::format("0x{:08X} ({})", code, abort.text);
  }
  return fmt::format("0x{:08X}", code);
}

std::string EmergencyText(uint16_t code) {
  for (const uint32_t mask : {0xFFFFu, 0xFF00u, 0xF000u}) {
    for (const Meaning& emergency : kEmergencies) {
      if (emergency.code == (code & mask))
        return fmt::format("0x{:04X} ({})", code, emergency.text);
    }
  }
  return fmt::format("0x{:04X}", code);
}

}  // namespace mesorig::daemon::cia402
