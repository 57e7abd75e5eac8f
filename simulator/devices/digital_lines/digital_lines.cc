#include "simulator/devices/digital_lines/digital_lines.h"

#include "protocol/base/log.h"

namespace mesorig::simulator {

void DigitalLinesDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) {
  const auto edge = sim_wire::UnpackLineEdge(payload);
  if (!edge.ok() || laser_ == nullptr || edge->line != lines_.laser_trigger) {
    spdlog::warn(
        "lines: command ignored ({})",
        edge.ok() ? fmt::format("line {} is not an output", edge->line) : Message(edge.status()));
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
  MESORIG_ASSIGN_OR_RETURN(bool level, Level(line, now));
  if (const auto stuck = stuck_.find(line); stuck != stuck_.end()) level = stuck->second;
  return std::string(1, level ? '\1' : '\0');
}

StatusOr<bool> DigitalLinesDevice::Level(int line, RigTime now) const {
  if (line == lines_.estop) return estop_closed_;
  if (line == lines_.door) return door_closed_;
  if (line == lines_.reset) return false;
  if (line == lines_.power) return contactor_.closed();
  if (laser_ != nullptr && line == lines_.laser_on) return laser_->Shines(now);
  if (laser_ != nullptr && line == lines_.laser_trigger) return trigger_;
  std::string wired;
  for (const int known : {lines_.estop, lines_.door, lines_.reset, lines_.power,
                          laser_ ? lines_.laser_trigger : -1, laser_ ? lines_.laser_on : -1}) {
    if (known >= 0) wired += fmt::format("{}{}", wired.empty() ? "" : ", ", known);
  }
  return InvalidArgument("line {} is not wired; wired are {}", line, wired);
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

void DigitalLinesDevice::SendPowerEdge(sim_wire::Outbox& out) {
  if (lines_.power < 0 || contactor_.closed() == power_said_) return;
  power_said_ = contactor_.closed();
  SendEdge(lines_.power, power_said_, out);
}

Status DigitalLinesDevice::Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) {
  const bool hand = text.starts_with("estop") || text.starts_with("door") || text == "reset";
  if (hand && !lines_.interlock) {
    return FailedPrecondition("lines: this rig has no interlock, so no \"{}\"", text);
  }
  if (text == "estop open" || text == "estop close") {
    estop_closed_ = text.ends_with("close");
    SetChainLine(lines_.estop, estop_closed_, now, out);
  } else if (text == "door open" || text == "door close") {
    door_closed_ = text.ends_with("close");
    SetChainLine(lines_.door, door_closed_, now, out);
  } else if (text == "reset") {  // pressed and let go
    SendEdge(lines_.reset, true, out);
    contactor_.ResetEdge(now);
    SendPowerEdge(out);
    SendEdge(lines_.reset, false, out);
  } else if (text == "weld") {
    contactor_.Weld();
  } else if (text.starts_with("stuck ") || text.starts_with("free ")) {
    return SetStuck(text.substr(text.find(' ') + 1), text.starts_with("stuck "), now, out);
  } else {
    return InvalidArgument(
        "lines: \"{}\" is not one of: estop open, estop close, door open, door close, reset, weld, "
        "stuck INPUT, free INPUT",
        text);
  }
  return OkStatus();
}

Status DigitalLinesDevice::SetStuck(std::string_view input, bool stuck, RigTime now,
                                    sim_wire::Outbox& out) {
  const int line = input == "estop"                           ? lines_.estop
                   : input == "door"                          ? lines_.door
                   : input == "power"                          ? lines_.power
                   : input == "laser_on" && laser_ != nullptr ? lines_.laser_on
                                                              : -1;
  if (line < 0) return InvalidArgument("lines: \"{}\" is no input that can be stuck", input);
  MESORIG_ASSIGN_OR_RETURN(const bool level, Level(line, now));
  if (stuck) {
    stuck_.emplace(line, level);
    return OkStatus();
  }
  const auto was = stuck_.find(line);
  if (was == stuck_.end()) return OkStatus();
  const bool changes = was->second != level;
  stuck_.erase(was);
  if (changes) SendEdge(line, level, out);
  return OkStatus();
}

void DigitalLinesDevice::SetChainLine(int line, bool closed, RigTime now, sim_wire::Outbox& out) {
  contactor_.SetChain(estop_closed_ && door_closed_, now);
  SendEdge(line, closed, out);
  SendPowerEdge(out);
  SendLaserEdge(now, out);
}

void DigitalLinesDevice::SendEdge(int line, bool level, sim_wire::Outbox& out) {
  if (stuck_.contains(line)) return;
  out.Send(sim_wire::Pack(
      sim_wire::LineEdge{static_cast<uint16_t>(line), static_cast<uint8_t>(level ? 1 : 0)}));
}

}  // namespace mesorig::simulator
