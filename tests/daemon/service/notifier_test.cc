#include "daemon/service/notifier.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "protocol/base/file_writer.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

v1::Event Ended() {
  v1::Event event;
  event.mutable_ended()->set_session_id("s1");
  event.mutable_ended()->set_reason("axis \"turntable\"\n$(touch /tmp/mesorig-owned) `id`");
  return event;
}
v1::Event State(v1::State state) {
  v1::Event event;
  event.mutable_state()->set_state(state);
  event.mutable_state()->set_reason("chain open");
  return event;
}

// Accepts connections; answers them when it is told to.
class WebListener {
 public:
  WebListener() {
    fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    EXPECT_EQ(::listen(fd_, 8), 0);
    socklen_t size = sizeof(address);
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }
  ~WebListener() { ::close(fd_); }
  std::string url() const { return fmt::format("http://127.0.0.1:{}/hook?key=hush", port_); }
  // One request, answered with `answer`.
  std::string Serve(const std::string& answer) {
    const int client = ::accept(fd_, nullptr, nullptr);
    std::string request;
    char buffer[4096];
    while (request.find('}') == request.npos) {
      const ssize_t n = ::recv(client, buffer, sizeof(buffer), 0);
      if (n <= 0) break;
      request.append(buffer, static_cast<size_t>(n));
    }
    (void)::send(client, answer.data(), answer.size(), MSG_NOSIGNAL);
    ::close(client);
    return request;
  }

 private:
  int fd_ = -1, port_ = 0;
};

void AwaitFigures(const Notifier& notifier, uint64_t sent, uint64_t failed) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (std::chrono::steady_clock::now() < limit) {
    const auto figures = notifier.figures();
    if (figures.sent >= sent && figures.failed >= failed) return;
    std::this_thread::yield();
  }
  ADD_FAILURE() << "sent " << notifier.figures().sent << ", failed " << notifier.figures().failed;
}

TEST(Notifier, TellsOfFaultsPromptsAndEnds) {
  EXPECT_EQ(NotificationOf(State(v1::FAULT)).kind, "fault");
  EXPECT_EQ(NotificationOf(State(v1::RUNNING)).kind, "");
  EXPECT_EQ(NotificationOf(Ended()).kind, "finish");
  v1::Event prompt;
  prompt.mutable_prompt()->set_text("mount low");
  EXPECT_EQ(NotificationOf(prompt).text, "mount low");
  const auto json =
      nlohmann::json::parse(NotificationJson(NotificationOf(Ended()), "r\xff", 7), nullptr, false);
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["session"], "s1");
  EXPECT_EQ(json["sequence"], 7);
}

TEST(Notifier, RunsTheCommandWithoutAShell) {
  TemporaryFolder folder;
  const std::string out = (folder.path() / "out").string();
  EventLog events;
  events.Append(Ended());  // before its time
  NotifierOptions options;
  options.command = {"/bin/sh", "-c", "{ cat; echo \"$MESORIG_EVENT|$MESORIG_TEXT\"; } >> \"$1\"",
                     "sh", out};
  {
    Notifier notifier(events, "rig", options, Notifier::Channel::kCommand);
    events.Append(State(v1::RUNNING));
    events.Append(Ended());
    AwaitFigures(notifier, 1, 0);
    EXPECT_EQ(notifier.figures().failed, 0u);
  }
  const std::string said = ReadFile(out).value();
  EXPECT_THAT(said, HasSubstr("\"event\":\"finish\""));
  EXPECT_THAT(said, HasSubstr("finish|incomplete: axis \"turntable\" $(touch"));
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 2) << said;
  EXPECT_FALSE(std::filesystem::exists("/tmp/mesorig-owned"));
}

TEST(Notifier, PostsToTheWebhook) {
  if (::access("/usr/bin/curl", X_OK) != 0) GTEST_SKIP() << "no curl here";
  WebListener web;
  EventLog events;
  NotifierOptions options;
  options.webhook = web.url();
  options.headers = {"Authorization: Bearer hush"};
  Notifier notifier(events, "rig", options, Notifier::Channel::kWebhook);
  events.Append(State(v1::FAULT));
  const std::string request = web.Serve("HTTP/1.1 204 No Content\r\n\r\n");
  EXPECT_THAT(request, HasSubstr("POST /hook?key=hush HTTP/1.1"));
  EXPECT_THAT(request, HasSubstr("Authorization: Bearer hush"));
  EXPECT_THAT(request, HasSubstr("Content-Type: application/json"));
  EXPECT_THAT(request, HasSubstr("\"text\":\"chain open\""));
  AwaitFigures(notifier, 1, 0);
  events.Append(Ended());
  web.Serve("HTTP/1.1 500 Oops\r\nContent-Length: 0\r\n\r\n");
  AwaitFigures(notifier, 1, 1);
}

TEST(Notifier, OneThatHangsHoldsNothingUp) {
  WebListener web;  // accepts, and never answers
  EventLog events;
  NotifierOptions options;
  options.webhook = web.url();
  options.command = {"/bin/sleep", "1000"};
  options.limit = milliseconds(100);
  Notifier command(events, "rig", options, Notifier::Channel::kCommand);
  Notifier webhook(events, "rig", options, Notifier::Channel::kWebhook);
  for (int i = 0; i < 3; ++i) events.Append(Ended());
  constexpr int kMore = 5000;  // (fewer than are kept)
  for (int i = 0; i < kMore; ++i) events.Append(State(v1::RUNNING));
  EXPECT_EQ(events.last(), 3u + kMore) << "events go on";
  AwaitFigures(command, 0, 3);
  AwaitFigures(webhook, 0, 3);
  options.limit = std::chrono::seconds(300);
  const auto before = std::chrono::steady_clock::now();
  {
    Notifier slow(events, "rig", options, Notifier::Channel::kCommand);
    events.Append(Ended());
  }
  EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(60)) << "ended with it";
}

TEST(Notifier, RefusesWhatItCannotUse) {
  NotifierOptions options;
  EXPECT_EQ(CheckNotifier(options), OkStatus());
  options.webhook = "http://host/\nurl = \"file:///etc/passwd\"";
  EXPECT_FALSE(CheckNotifier(options).ok());
  options.webhook = "https://host/";
  EXPECT_EQ(CheckNotifier(options), OkStatus());
  options.headers = {"no colon"};
  EXPECT_FALSE(CheckNotifier(options).ok());
  options.headers.clear();
  options.limit = milliseconds(1);
  EXPECT_FALSE(CheckNotifier(options).ok());
}

}  // namespace
}  // namespace mesorig::daemon
