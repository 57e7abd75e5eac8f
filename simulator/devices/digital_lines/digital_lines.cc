#include "simulator/devices/digital_lines/digital_lines.h"

namespace mesorig::simulator {

void DigitalLinesDevice::Command(RigTime, std::string_view, sim_wire::Outbox&) {}

StatusOr<std::string> DigitalLinesDevice::Query(RigTime, std::string_view payload,
                                                sim_wire::Outbox&) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t line, sim_wire::UnpackLineQuery(payload));
  bool level = false;
  if (line == lines_.estop) {
    level = estop_closed_;
  } else if (line == lines_.door) {
    level = door_closed_;
  } else if (line != lines_.reset) {
    return InvalidArgument("line {} is not wired; wired are {}, {}, {}", line, lines_.estop,
                           lines_.door, lines_.reset);
  }
  return std::string(1, level ? '\1' : '\0');
}

void DigitalLinesDevice::RunEvent(RigTime, sim_wire::Outbox&) {}

Status DigitalLinesDevice::Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) {
  if (text == "estop open" || text == "estop close") {
    estop_closed_ = text.ends_with("close");
    SetChainLine(lines_.estop, estop_closed_, now, out);
  } else if (text == "door open" || text == "door close") {
    door_closed_ = text.ends_with("close");
    SetChainLine(lines_.door, door_closed_, now, out);
  } else if (text == "reset") {  // pressed and let go
    SendEdge(lines_.reset, true, out);
    contactor_.ResetEdge(now);
    SendEdge(lines_.reset, false, out);
  } else {
    return InvalidArgument(
        "lines: \"{}\" is not one of: estop open, estop close, door open, door close, reset", text);
  }
  return OkStatus();
}

void DigitalLinesDevice::SetChainLine(int line, bool closed, RigTime now, sim_wire::Outbox& out) {
  contactor_.SetChain(estop_closed_ && door_closed_, now);
  SendEdge(line, closed, out);
}

void DigitalLinesDevice::SendEdge(int line, bool level, sim_wire::Outbox& out) {
  out.Send(sim_wire::Pack(
      sim_wire::LineEdge{static_cast<uint16_t>(line), static_cast<uint8_t>(level ? 1 : 0)}));
}

}  // namespace mesorig::simulator
