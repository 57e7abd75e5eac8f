#include "daemon/bus/sim_line_port.h"

#include "protocol/base/log.h"
#include "protocol/sim_wire/payloads.h"

namespace mesorig::daemon {

StatusOr<std::unique_ptr<SimLinePort>> SimLinePort::Open(sim_wire::SimLink& link) {
  MESORIG_ASSIGN_OR_RETURN(const uint16_t device, link.FindDevice(sim_wire::kLinesDevice));
  return std::unique_ptr<SimLinePort>(new SimLinePort(link, device));
}

SimLinePort::~SimLinePort() {
  link_.Subscribe(device_, [](RigTime, std::string) {});
}

StatusOr<bool> SimLinePort::Read(int line) {
  const auto answer = link_.Query(device_, sim_wire::PackLineQuery(static_cast<uint16_t>(line)));
  if (!answer.ok()) return Annotate(answer.status(), fmt::format("line {}", line));
  if (answer->size() != 1 || static_cast<uint8_t>((*answer)[0]) > 1) {
    return Unavailable("line {}: the answer of {} bytes is no level", line, answer->size());
  }
  return (*answer)[0] == 1;
}

Status SimLinePort::Write(int line, bool level) {
  const sim_wire::LineEdge edge{static_cast<uint16_t>(line), static_cast<uint8_t>(level ? 1 : 0)};
  return Annotate(link_.Post(device_, sim_wire::Pack(edge)), fmt::format("line {}", line));
}

void SimLinePort::OnEdge(std::function<void(int line, bool level, RigTime when)> handler) {
  link_.Subscribe(device_, [handler = std::move(handler)](RigTime time, std::string payload) {
    const auto edge = sim_wire::UnpackLineEdge(payload);
    if (!edge.ok()) {
      Log("bus").warn("lines: {}", Message(edge.status()));
      return;
    }
    handler(edge->line, edge->level == 1, time);
  });
}

}  // namespace mesorig::daemon
