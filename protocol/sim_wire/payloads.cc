#include "protocol/sim_wire/payloads.h"

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"

namespace mesorig::sim_wire {
namespace {

constexpr size_t kFrameHeader = 4 + 8 + 8 + 8 + 2 + 2 + 1;

uint64_t FrameChecksum(std::string_view header, std::string_view pixels) {
  return Checksum(header) + 31 * Checksum(pixels);
}

Status Malformed(std::string_view what) { return InvalidArgument("malformed {} payload", what); }

}  // namespace

std::string CameraDevice(std::string_view serial) { return fmt::format("camera:{}", serial); }

std::string Pack(const CanFrame& frame) {
  ByteWriter out;
  out.Put(frame.id).Put(frame.size);
  for (uint8_t byte : frame.data) out.Put(byte);
  return out.Take();
}

StatusOr<CanFrame> UnpackCanFrame(std::string_view bytes) {
  ByteReader in(bytes);
  CanFrame frame;
  frame.id = in.Get<uint16_t>();
  frame.size = in.Get<uint8_t>();
  for (uint8_t& byte : frame.data) byte = in.Get<uint8_t>();
  if (!in.done() || frame.size > 8 || frame.id > 0x7FF) return Malformed("CAN");
  return frame;
}

std::string PackLineQuery(uint16_t line) { return ByteWriter().Put(line).Take(); }

StatusOr<uint16_t> UnpackLineQuery(std::string_view bytes) {
  ByteReader in(bytes);
  const auto line = in.Get<uint16_t>();
  if (!in.done()) return Malformed("line query");
  return line;
}

std::string Pack(const LineEdge& edge) {
  return ByteWriter().Put(edge.line).Put(edge.level).Take();
}

StatusOr<LineEdge> UnpackLineEdge(std::string_view bytes) {
  ByteReader in(bytes);
  LineEdge edge;
  edge.line = in.Get<uint16_t>();
  edge.level = in.Get<uint8_t>();
  if (!in.done() || edge.level > 1) return Malformed("line edge");
  return edge;
}

std::string Pack(const CameraAccess& access) {
  return ByteWriter()
      .Put(static_cast<uint16_t>(access.reg))
      .Put<uint8_t>(access.write ? 1 : 0)
      .Put(access.value)
      .Take();
}

StatusOr<CameraAccess> UnpackCameraAccess(std::string_view bytes) {
  ByteReader in(bytes);
  const auto reg = in.Get<uint16_t>();
  const auto write = in.Get<uint8_t>();
  const auto value = in.Get<double>();
  if (!in.done() || reg < 1 || reg > static_cast<uint16_t>(kLastCameraRegister) || write > 1)
    return Malformed("camera register");
  return CameraAccess{static_cast<CameraRegister>(reg), write == 1, value};
}

std::string PackRegisterValue(double value) { return ByteWriter().Put(value).Take(); }

StatusOr<double> UnpackRegisterValue(std::string_view bytes) {
  ByteReader in(bytes);
  const auto value = in.Get<double>();
  if (!in.done()) return Malformed("register value");
  return value;
}

std::string Pack(const CameraTrigger& trigger) {
  return ByteWriter().Put(trigger.trigger_id).Take();
}

StatusOr<CameraTrigger> UnpackCameraTrigger(std::string_view bytes) {
  ByteReader in(bytes);
  const auto id = in.Get<uint32_t>();
  if (!in.done()) return Malformed("camera trigger");
  return CameraTrigger{id};
}

std::string Pack(const CameraFrame& frame) {
  const std::string header = ByteWriter()
                                 .Put(frame.trigger_id)
                                 .Put(frame.frame_id)
                                 .Put<int64_t>(frame.exposure_start.count())
                                 .Put<int64_t>(frame.exposure_end.count())
                                 .Put(frame.width)
                                 .Put(frame.height)
                                 .Put(frame.bits)
                                 .Take();
  return ByteWriter()
      .PutRaw(header)
      .Put(FrameChecksum(header, frame.pixels))
      .PutRaw(frame.pixels)
      .Take();
}

StatusOr<CameraFrame> UnpackCameraFrame(std::string_view bytes) {
  ByteReader in(bytes);
  CameraFrame frame;
  frame.trigger_id = in.Get<uint32_t>();
  frame.frame_id = in.Get<uint64_t>();
  frame.exposure_start = RigTime(in.Get<int64_t>());
  frame.exposure_end = RigTime(in.Get<int64_t>());
  frame.width = in.Get<uint16_t>();
  frame.height = in.Get<uint16_t>();
  frame.bits = in.Get<uint8_t>();
  const auto checksum = in.Get<uint64_t>();
  const std::string_view pixels = in.GetRaw(in.remaining());
  const size_t size = size_t{frame.width} * frame.height * (frame.bits > 8 ? 2 : 1);
  if (!in.done() || (frame.bits != 8 && frame.bits != 12) || pixels.size() > size ||
      checksum != FrameChecksum(bytes.substr(0, kFrameHeader), pixels)) {
    return Malformed("camera frame");
  }
  if (pixels.size() < size) {
    return DataLoss("frame of trigger {}: {} of {} bytes of pixels", frame.trigger_id,
                    pixels.size(), size);
  }
  frame.pixels = pixels;
  return frame;
}

}  // namespace mesorig::sim_wire
