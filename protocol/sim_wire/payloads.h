#pragma once
// What travels inside commands, queries, replies and outputs of the stand-in buses. Every Unpack
// refuses bytes that are not exactly one payload (InvalidArgument).

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::sim_wire {

// Device names in Welcome::devices. Cameras are "camera:<serial>".
inline constexpr std::string_view kCanDevice = "can";
inline constexpr std::string_view kLampsDevice = "lamps";  // commanded by Modbus TCP, not here
inline constexpr std::string_view kLinesDevice = "lines";
// The NXT brick's bulk endpoints: a command is one telegram to OUT 0x01, an output one from IN 0x82.
// Only in rigs with a laser.
inline constexpr std::string_view kNxtDevice = "nxt";
std::string CameraDevice(std::string_view serial);

// One classic CAN frame, 11-bit identifier. Commands are frames to the bus, outputs from it.
struct CanFrame {
  uint16_t id = 0;
  uint8_t size = 0;  // 0..8
  std::array<uint8_t, 8> data{};
  friend bool operator==(const CanFrame&, const CanFrame&) = default;
};
std::string Pack(const CanFrame& frame);
StatusOr<CanFrame> UnpackCanFrame(std::string_view bytes);

// Digital lines. Query with a line number (u16) is answered by its level (u8). Output: an edge of an
// input. Command: a LineEdge sets an output line to a level.
struct LineEdge {
  uint16_t line = 0;
  uint8_t level = 0;
};
std::string PackLineQuery(uint16_t line);
StatusOr<uint16_t> UnpackLineQuery(std::string_view bytes);
std::string Pack(const LineEdge& edge);
StatusOr<LineEdge> UnpackLineEdge(std::string_view bytes);

// Camera registers, written and read by query; values are doubles. The region is what the next
// frames hold (Region of protocol/rig); width and height are written before x and y grow.
enum class CameraRegister : uint16_t {
  kExposureS = 1,
  kGain = 2,
  kRepeatIndex = 3,
  kRegionX = 4,
  kRegionY = 5,
  kRegionWidth = 6,
  kRegionHeight = 7,
  kDeviceTime_s = 8,  // read only: what the camera's own clock says
};
inline constexpr CameraRegister kLastCameraRegister = CameraRegister::kDeviceTime_s;
struct CameraAccess {
  CameraRegister reg{};
  bool write = false;
  double value = 0;  // written; ignored for a read
};
std::string Pack(const CameraAccess& access);
StatusOr<CameraAccess> UnpackCameraAccess(std::string_view bytes);
// The reply's payload is the register's value after the access.
std::string PackRegisterValue(double value);
StatusOr<double> UnpackRegisterValue(std::string_view bytes);

// A camera command is a software trigger.
struct CameraTrigger {
  uint32_t trigger_id = 0;
};
std::string Pack(const CameraTrigger& trigger);
StatusOr<CameraTrigger> UnpackCameraTrigger(std::string_view bytes);

// A camera's output: one frame, rows from the top, 8 bits a pixel or 12 in two bytes. The times are
// the camera's own clock's. A checksum over all of it stands for the one that real transports have.
struct CameraFrame {
  uint32_t trigger_id = 0;
  uint64_t frame_id = 0;  // counts this camera's frames from 1 since power-on
  RigTime exposure_start{}, exposure_end{};
  uint16_t width = 0, height = 0;
  uint8_t bits = 0;
  std::string pixels;
};
std::string Pack(const CameraFrame& frame);
// DataLoss when pixels are missing (a torn frame); InvalidArgument for anything else that is not
// one whole frame.
StatusOr<CameraFrame> UnpackCameraFrame(std::string_view bytes);

}  // namespace mesorig::sim_wire
