#include "daemon/service/notifier.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "protocol/base/child_process.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr std::chrono::milliseconds kLook{200};  // how late the end is noticed
constexpr std::chrono::milliseconds kGrace{500};
constexpr std::array<std::string_view, 4> kKinds = {"fault", "prompt", "finish", "alarm"};

// A quoted value of a file of curl's options (curl(1), --config).
std::string Quoted(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += c;
  }
  return quoted + '"';
}

// Everything over stdin: what stands in argv is seen by every user of this machine.
ChildCommand CurlCommand(const NotifierOptions& options, const std::string& json) {
  ChildCommand command;
  command.argv = {options.curl, "--config", "-"};
  command.input = fmt::format(
      "url = {}\nrequest = \"POST\"\ndata-binary = {}\nheader = \"Content-Type: "
      "application/json\"\n"
      "silent\nshow-error\nfail\noutput = \"/dev/null\"\nproto = \"=http,https\"\nmax-time = "
      "{:.1f}\n",
      Quoted(options.webhook), Quoted(json), static_cast<double>(options.limit.count()) / 1e3);
  for (const std::string& header : options.headers) {
    command.input += fmt::format("header = {}\n", Quoted(header));
  }
  command.limit = options.limit + std::chrono::milliseconds(500);
  return command;
}

bool HasControl(std::string_view text) {
  return std::any_of(text.begin(), text.end(),
                     [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

// An environment variable has no zeros, and a terminal no control characters.
std::string Clean(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  return text;
}

}  // namespace

Status CheckNotifier(const NotifierOptions& options) {
  const std::string& url = options.webhook;
  if (!url.empty() &&
      (!(url.starts_with("http://") || url.starts_with("https://")) || HasControl(url))) {
    return InvalidArgument("notify.webhook is no http:// or https:// address");
  }
  for (const std::string& header : options.headers) {
    if (HasControl(header) || header.find(':') == header.npos) {
      return InvalidArgument("notify.headers: each is one line \"Name: value\"");
    }
  }
  for (const std::string& kind : options.on) {
    if (std::find(kKinds.begin(), kKinds.end(), kind) == kKinds.end()) {
      return InvalidArgument("notify.on: \"{}\" is none of fault, prompt, finish, alarm", kind);
    }
  }
  const auto ms = options.limit.count();
  if (ms < 100 || ms > 300'000) {
    return InvalidArgument("notify.timeout_s: {} s is not in [0.1, 300] s",
                           static_cast<double>(ms) / 1e3);
  }
  return OkStatus();
}

Notification NotificationOf(const v1::Event& event) {
  switch (event.what_case()) {
    case v1::Event::kState:
      if (event.state().state() != v1::FAULT) return {};
      return {"fault", "", event.state().reason()};
    case v1::Event::kPrompt:
      return {"prompt", "", event.prompt().text()};
    case v1::Event::kEnded:
      return {"finish", event.ended().session_id(),
              event.ended().complete()
                  ? fmt::format("complete, {} frames", event.ended().frames_durable())
                  : "incomplete: " + event.ended().reason()};
    case v1::Event::kAlarm:
      return {"alarm", event.alarm().session_id(), event.alarm().text()};
    default:
      return {};
  }
}

std::string NotificationJson(const Notification& notification, const std::string& rig,
                             uint64_t sequence) {
  const nlohmann::ordered_json json = {{"event", notification.kind},
                                       {"rig", rig},
                                       {"session", notification.session},
                                       {"text", notification.text},
                                       {"sequence", sequence}};
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Notifier::Notifier(EventLog& events, std::string rig, NotifierOptions options, Channel channel)
    : events_(events),
      rig_(std::move(rig)),
      options_(std::move(options)),
      channel_(channel),
      cursor_(events.last()),
      thread_([this] { Loop(); }) {}

Notifier::~Notifier() {
  // When the daemon ends, what happened last is still told, if that is quick.
  const auto limit = std::chrono::steady_clock::now() + kGrace;
  while (!done_ && events_.closed() && std::chrono::steady_clock::now() < limit) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ending_ = true;
  thread_.join();
}

void Notifier::Loop() {
  while (!ending_) {
    const std::vector<v1::Event> events = events_.Read(cursor_, events_.life(), kLook);
    if (events.empty() && events_.closed()) break;
    for (const v1::Event& event : events) {
      cursor_ = event.sequence();
      if (event.has_gap()) {
        Log("notify").warn("{}: events {} to {} came faster than they could be told",
                           Name(channel_), event.gap().first(), event.gap().last());
      }
      const Notification notification = NotificationOf(event);
      const bool wanted =
          std::find(options_.on.begin(), options_.on.end(), notification.kind) != options_.on.end();
      if (wanted && !ending_) Tell(notification, event.sequence());
    }
  }
  done_ = true;
}

void Notifier::Tell(const Notification& notification, uint64_t sequence) {
  const std::string json = NotificationJson(notification, rig_, sequence);
  ChildCommand command;
  if (channel_ == Channel::kWebhook) {
    command = CurlCommand(options_, json);
  } else {
    command.argv = options_.command;
    command.input = json + '\n';
    command.limit = options_.limit;
    command.environment = {"MESORIG_EVENT=" + notification.kind,
                           "MESORIG_SESSION=" + Clean(notification.session),
                           "MESORIG_TEXT=" + Clean(notification.text)};
  }
  const auto outcome = RunChild(command, &ending_);
  if (outcome.ok() && outcome->code == 0) {
    ++sent_;
    return;
  }
  ++failed_;
  // (What curl says may hold the address, and with it a secret.)
  const std::string said = outcome.ok() && channel_ == Channel::kCommand ? outcome->output : "";
  Log("notify").warn("{} of event {} ({}): {}{}{}", Name(channel_), sequence, notification.kind,
                     outcome.ok() ? fmt::format("ended with {}", outcome->code)
                                  : std::string(Message(outcome.status())),
                     said.empty() ? "" : ": ", said);
}

}  // namespace mesorig::daemon
