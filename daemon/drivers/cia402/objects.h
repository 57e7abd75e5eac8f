#pragma once
// The object dictionary entries that the driver uses (CiA 301, CiA 402-2), and the drive's states.

#include <cstdint>
#include <string>
#include <string_view>

namespace mesorig::daemon::cia402 {

struct Object {
  uint16_t index = 0;
  uint8_t sub = 0;
  uint8_t size = 0;  // bytes
  std::string_view name;
};

inline constexpr Object kConsumerHeartbeat{0x1016, 1, 4, "consumer heartbeat time"};
inline constexpr Object kProducerHeartbeat{0x1017, 0, 2, "producer heartbeat time"};
// Manufacturer's: where the last homing found the reference, by the count before it.
inline constexpr Object kReferenceFound{0x2001, 0, 4, "reference found at"};
inline constexpr Object kAbortOption{0x6007, 0, 2, "abort connection option code"};
inline constexpr Object kQuickStopOption{0x605A, 0, 2, "quick stop option code"};
inline constexpr Object kControlword{0x6040, 0, 2, "controlword"};
inline constexpr Object kStatusword{0x6041, 0, 2, "statusword"};
inline constexpr Object kModeOfOperation{0x6060, 0, 1, "modes of operation"};
inline constexpr Object kActualPosition{0x6064, 0, 4, "position actual value"};
inline constexpr Object kFollowingErrorWindow{0x6065, 0, 4, "following error window"};
inline constexpr Object kLowerLimit{0x607D, 1, 4, "software position limit: min"};
inline constexpr Object kUpperLimit{0x607D, 2, 4, "software position limit: max"};
inline constexpr Object kProfileVelocity{0x6081, 0, 4, "profile velocity"};
inline constexpr Object kProfileAcceleration{0x6083, 0, 4, "profile acceleration"};
inline constexpr Object kProfileDeceleration{0x6084, 0, 4, "profile deceleration"};
inline constexpr Object kHomingMethod{0x6098, 0, 1, "homing method"};
inline constexpr Object kHomingSearchSpeed{0x6099, 1, 4, "homing speed: search for switch"};
inline constexpr Object kHomingZeroSpeed{0x6099, 2, 4, "homing speed: search for zero"};
inline constexpr Object kHomingAcceleration{0x609A, 0, 4, "homing acceleration"};

inline constexpr uint8_t kProfilePositionMode = 1, kHomingMode = 6;

// Controlwords.
inline constexpr uint16_t kDisableVoltage = 0x0000, kQuickStopCommand = 0x0002, kShutdown = 0x0006;
inline constexpr uint16_t kSwitchOn = 0x0007, kEnableOperation = 0x000F, kFaultReset = 0x0080;
inline constexpr uint16_t kStartBit = 0x0010;  // new set-point; homing start

// Statusword bits.
inline constexpr uint16_t kTargetReached = 1 << 10;
inline constexpr uint16_t kInternalLimit = 1 << 11;  // the set-point was beyond a limit
inline constexpr uint16_t kSetPointAcknowledged = 1 << 12;  // profile position
inline constexpr uint16_t kHomingAttained = 1 << 12;        // homing
inline constexpr uint16_t kFollowingError = 1 << 13;         // profile position
inline constexpr uint16_t kHomingError = 1 << 13;            // homing

enum class DriveState {
  kNotReadyToSwitchOn,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStopActive,
  kFaultReactionActive,
  kFault,
};
DriveState StateOf(uint16_t statusword);  // CiA 402-2, "state coding"
std::string_view Text(DriveState state);
// "0x06090030 (value out of range)": CiA 301, table of SDO abort codes.
std::string SdoAbortText(uint32_t code);
// "0x8130 (heartbeat lost)": CiA 301 and CiA 402-2, emergency error codes.
std::string EmergencyText(uint16_t code);

}  // namespace mesorig::daemon::cia402
