#include "client/cli/text.h"

#include <fmt/core.h>
#include <google/protobuf/util/json_util.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

namespace mesorig::client {

std::string_view StateName(v1::State state) {
  switch (state) {
    case v1::IDLE:
      return "idle";
    case v1::RUNNING:
      return "running";
    case v1::WAITING:
      return "waiting for the operator";
    case v1::STOPPING:
      return "stopping";
    case v1::FAULT:
      return "fault";
    case v1::ARMED:
      return "armed";
    case v1::PAUSING:
      return "pausing";
    case v1::PAUSED:
      return "paused";
    default:
      return "unknown";
  }
}

std::string BytesText(uint64_t bytes) {
  const double b = static_cast<double>(bytes);
  if (b < 1e6) return fmt::format("{:.1f} kB", b / 1e3);
  if (b < 1e9) return fmt::format("{:.1f} MB", b / 1e6);
  return fmt::format("{:.2f} GB", b / 1e9);
}

std::string DurationText(double seconds) {
  if (!(seconds >= 60)) return fmt::format("{:.1f} s", seconds);
  const auto whole = static_cast<int64_t>(std::llround(seconds));
  if (whole < 3600) return fmt::format("{} min {} s", whole / 60, whole % 60);
  return fmt::format("{} h {} min", whole / 3600, whole % 3600 / 60);
}

std::string StillNeeded(const v1::Prompt& prompt) {
  std::string missing;
  const auto add = [&](bool done, std::string_view what) {
    if (!done) missing += fmt::format("{}{}", missing.empty() ? "" : ", ", what);
  };
  add(prompt.door_cycled(), "the door opened and closed");
  add(prompt.reset(), "reset pressed");
  add(prompt.acknowledged(), "`mesorig acknowledge`");
  return missing.empty() ? "nothing" : missing;
}

std::string PromptText(const v1::Prompt& prompt) {
  return fmt::format("prompt {}: {} (still needed: {})", prompt.id(), prompt.text(),
                     StillNeeded(prompt));
}

std::string LeaseText(const v1::LeaseStatus& lease) {
  const std::string asked =
      lease.requested_by().empty() ? "" : fmt::format("; {} asks for it", lease.requested_by());
  switch (lease.kind()) {
    case v1::LEASE_MANUAL:
      return fmt::format("{} has control of the rig, for another {:.1f} s unless it is renewed{}",
                         lease.holder(), lease.left_s(), asked);
    case v1::LEASE_RUN:
      return fmt::format("a plan that {} began has control of the rig", lease.holder());
    default:
      return lease.requested_by().empty()
                 ? "nobody has control of the rig"
                 : fmt::format("control of the rig was given up for {}", lease.requested_by());
  }
}

std::string EventText(const v1::Event& event) {
  const std::string when = fmt::format("{:10.3f} s  ", event.rig_s());
  switch (event.what_case()) {
    case v1::Event::kState:
      return fmt::format("{}{}{}{}", when, StateName(event.state().state()),
                         event.state().reason().empty() ? "" : ": ", event.state().reason());
    case v1::Event::kStarted:
      return fmt::format("{}session {}{}: {} shots, {} frames", when, event.started().session_id(),
                         event.started().resumed() ? " resumed" : "", event.started().shots(),
                         event.started().frames());
    case v1::Event::kProgress:
      return fmt::format("{}{} shots, {} frames durable", when, event.progress().shots_done(),
                         event.progress().frames_durable());
    case v1::Event::kEnded:
      return fmt::format("{}session {} {}{}, {} frames durable", when, event.ended().session_id(),
                         event.ended().complete() ? "complete" : "incomplete: ",
                         event.ended().reason(), event.ended().frames_durable());
    case v1::Event::kPrompt:
      return when + PromptText(event.prompt());
    case v1::Event::kAlarm:
      return fmt::format("{}ALARM {}", when, event.alarm().text());
    case v1::Event::kNote:
      return when + event.note();
    case v1::Event::kGap:
      return event.gap().other_life() ? when + "mesorigd began anew: what was before is over"
                                      : fmt::format("{}events {} to {} are no longer kept", when,
                                                    event.gap().first(), event.gap().last());
    case v1::Event::kLease:
      return fmt::format("{}control of the rig: {}: {}{}{}", when, event.lease().change(),
                         event.lease().holder(), event.lease().requester().empty() ? "" : ", ",
                         event.lease().requester());
    default:
      return when + "(an event of a newer daemon)";
  }
}

std::string JsonText(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  if (!google::protobuf::util::MessageToJsonString(message, &json, options).ok()) return "{}";
  return json;
}

ProgressBar::ProgressBar() : terminal_(::isatty(STDERR_FILENO) == 1) {}

ProgressBar::~ProgressBar() {
  if (shown_) fmt::print(stderr, "\n");
}

void ProgressBar::Show(uint32_t done, uint32_t total, std::string_view unit) {
  if (!terminal_ || total == 0) return;
  constexpr int kWidth = 40;
  const int filled = static_cast<int>(static_cast<double>(done) / total * kWidth);
  fmt::print(stderr, "\r[{}{}] {}/{} {}", std::string(static_cast<size_t>(filled), '#'),
             std::string(static_cast<size_t>(std::max(0, kWidth - filled)), ' '), done, total,
             unit);
  std::fflush(stderr);
  shown_ = true;
}

}  // namespace mesorig::client
