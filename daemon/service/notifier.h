#pragma once
// Tells people of what they should know now: a fault, a prompt, an end. Reads the event log on a
// thread of its own, like any client, and runs one program an event: whoever is slow, hangs or fails
// holds nothing up but the notifications after it.

#include <atomic>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "daemon/service/event_log.h"
#include "protocol/base/status.h"

namespace mesorig::daemon {

struct NotifierOptions {
  // A program and its arguments, run without a shell. It gets the event as one line of JSON on its
  // stdin, and as MESORIG_EVENT, MESORIG_SESSION and MESORIG_TEXT in its environment.
  std::vector<std::string> command;
  // The same JSON, POSTed to this http(s) address by curl; `headers` are "Name: value" lines.
  std::string webhook;
  std::vector<std::string> headers;
  std::vector<std::string> on = {"fault", "prompt", "finish"};
  std::chrono::milliseconds limit{10'000};  // each, host time
  std::string curl = "curl";
};

// InvalidArgument for an address that is not http(s)://…, a header of more than one line, an event
// that is none of fault, prompt, finish, alarm, and a limit outside 0.1 … 300 s.
Status CheckNotifier(const NotifierOptions& options);

// What is told of an event; `kind` empty: nothing.
struct Notification {
  std::string kind;  // "fault", "prompt", "finish", "alarm"
  std::string session, text;
};
Notification NotificationOf(const v1::Event& event);
// One line: {"event":…,"rig":…,"session":…,"text":…,"sequence":…}
std::string NotificationJson(const Notification& notification, const std::string& rig,
                             uint64_t sequence);

// One channel: the command, or the webhook (never both in one). Borrows the log, which outlives it.
class Notifier {
 public:
  enum class Channel { kCommand, kWebhook };
  struct Figures {
    uint64_t sent = 0, failed = 0;
  };

  // Events from now on.
  Notifier(EventLog& events, std::string rig, NotifierOptions options, Channel channel);
  ~Notifier();  // ends a program that still runs
  Notifier(const Notifier&) = delete;
  Notifier& operator=(const Notifier&) = delete;
  Figures figures() const { return {sent_, failed_}; }  // any thread
  static std::string_view Name(Channel channel) {
    return channel == Channel::kCommand ? "command" : "webhook";
  }
  Channel channel() const { return channel_; }

 private:
  void Loop();
  void Tell(const Notification& notification, uint64_t sequence);

  EventLog& events_;
  const std::string rig_;
  const NotifierOptions options_;
  const Channel channel_;
  uint64_t cursor_;  // of the thread
  std::atomic<bool> ending_{false}, done_{false};
  std::atomic<uint64_t> sent_{0}, failed_{0};
  std::thread thread_;
};

}  // namespace mesorig::daemon
