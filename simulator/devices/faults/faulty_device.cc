#include "simulator/devices/faults/faulty_device.h"

#include <algorithm>

namespace mesorig::simulator {

using Way = MessageFaults::Way;

FaultyDevice::FaultyDevice(sim_wire::SimDevice& device) : device_(device) {
  messages_.OnPlug([this](bool plugged, RigTime now) { device_.Plug(now, plugged, plug_said_); });
}

void FaultyDevice::PassOut(RigTime now, sim_wire::Outbox& said, sim_wire::Outbox& out) {
  for (std::string& message : said.Take()) {
    for (std::string& passed : messages_.Pass(Way::kOut, now, std::move(message))) {
      out.Send(std::move(passed));
    }
  }
}

void FaultyDevice::Command(RigTime now, std::string_view payload, sim_wire::Outbox& out) {
  sim_wire::Outbox said;
  for (const std::string& passed : messages_.Pass(Way::kIn, now, std::string(payload))) {
    device_.Command(now, passed, said);
  }
  PassOut(now, said, out);
}

StatusOr<std::string> FaultyDevice::Query(RigTime now, std::string_view payload,
                                          sim_wire::Outbox& out) {
  if (!messages_.plugged()) return Unavailable("{} is not there: it is unplugged", name());
  const auto asked = messages_.Pass(Way::kIn, now, std::string(payload));
  if (asked.empty()) return Unavailable("{} does not answer", name());
  sim_wire::Outbox said;
  const auto answer = device_.Query(now, asked.front(), said);
  PassOut(now, said, out);
  if (!answer.ok()) return answer;
  auto answered = messages_.Pass(Way::kOut, now, *answer);
  if (answered.empty()) return Unavailable("{} does not answer", name());
  return std::move(answered.front());
}

RigTime FaultyDevice::NextEvent() const {
  return std::min(messages_.NextEvent(), device_.NextEvent());
}

void FaultyDevice::RunEvent(RigTime now, sim_wire::Outbox& out) {
  if (messages_.NextEvent() <= now) {
    for (MessageFaults::Late& late : messages_.RunEvent(now)) {
      sim_wire::Outbox said;
      if (late.way == Way::kOut && on_late_) {
        on_late_(std::move(late.message));
      } else if (late.way == Way::kOut) {
        out.Send(std::move(late.message));
      } else {
        device_.Command(now, late.message, said);
      }
      PassOut(now, said, out);
    }
    PassOut(now, plug_said_, out);
  }
  if (device_.NextEvent() > now) return;
  sim_wire::Outbox said;
  device_.RunEvent(now, said);
  PassOut(now, said, out);
}

Status FaultyDevice::Inject(RigTime now, std::string_view text, sim_wire::Outbox& out) {
  const auto injected = messages_.Inject(now, text);
  sim_wire::Outbox said = std::exchange(plug_said_, {});
  const Status status = injected ? Annotate(*injected, name()) : device_.Inject(now, text, said);
  PassOut(now, said, out);
  return status;
}

FaultyDevices::FaultyDevices(const std::vector<sim_wire::SimDevice*>& devices) {
  for (sim_wire::SimDevice* device : devices) {
    devices_.push_back(std::make_unique<FaultyDevice>(*device));
  }
}

std::vector<sim_wire::SimDevice*> FaultyDevices::All() const {
  std::vector<sim_wire::SimDevice*> all;
  for (const auto& device : devices_) all.push_back(device.get());
  return all;
}

FaultyDevice* FaultyDevices::Find(std::string_view name) const {
  for (const auto& device : devices_) {
    if (device->name() == name) return device.get();
  }
  return nullptr;
}

}  // namespace mesorig::simulator
