#include "simulator/devices/digital_lines/digital_lines.h"

#include "protocol/base/log.h"

namespace mesorig::simulator {

void DigitalLinesDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) {
  const auto edge = sim_wire::UnpackLineEdge(payload);
  if (!edge.ok() || laser_ == nullptr || edge->line != lines_.laser_trigger) {
    spdlog::warn("lines: command ignored ({})",
                 edge.ok() ? fmt::format("line {} is not an output", edge->line)
                           : Message(edge.status()));
    return;
  }
  const bool rising = edge->level == 1 && !trigger_;
  trigger_ = edge->level == 1;
  if (rising) laser_->Trigger(now);
  SendLaserEdge(now, out);
}

StatusOr<std::string> DigitalLinesDevice::Query(RigTime now, std::string_view payload,
                                                sim_wire::Outbox&) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t line, sim_wire::UnpackLineQuery(payload));
  bool level = false;
  if (line == lines_.estop) {
    level = estop_closed_;
  } else if (line == lines_.door) {
    level = door_closed_;
  } else if (laser_ != nullptr && line == lines_.laser_on) {
    level = laser_->Shines(now);
  } else if (laser_ != nullptr && line == lines_.laser_trigger) {
    level = trigger_;
  } else if (line != lines_.reset) {
    const std::string more =
        laser_ ? fmt::format(", {}, {}", lines_.laser_trigger, lines_.laser_on) : "";
    return InvalidArgument("line {} is not wired; wired are {}, {}, {}{}", line, lines_.estop,
                           lines_.door, lines_.reset, more);
  }
  return std::string(1, level ? '\1' : '\0');
}

RigTime DigitalLinesDevice::NextEvent() const {
  if (laser_ == nullptr) return kNever;
  // The contactor or the brick may have switched it off.
  if (laser_->Shines(laser_->last_change()) != laser_said_) return laser_->last_change();
  return laser_->GateEnd();
}

void DigitalLinesDevice::RunEvent(RigTime now, sim_wire::Outbox& out) {
  laser_->ExpireGate(now);
  SendLaserEdge(now, out);
}

void DigitalLinesDevice::SendLaserEdge(RigTime now, sim_wire::Outbox& out) {
  if (laser_ == nullptr || laser_->Shines(now) == laser_said_) return;
  laser_said_ = !laser_said_;
  SendEdge(lines_.laser_on, laser_said_, out);
}

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
  SendLaserEdge(now, out);
}

void DigitalLinesDevice::SendEdge(int line, bool level, sim_wire::Outbox& out) {
  out.Send(sim_wire::Pack(
      sim_wire::LineEdge{static_cast<uint16_t>(line), static_cast<uint8_t>(level ? 1 : 0)}));
}

}  // namespace mesorig::simulator
