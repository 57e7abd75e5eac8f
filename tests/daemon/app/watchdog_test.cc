#include "daemon/app/watchdog.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class WatchdogTest : public ::testing::Test {
 protected:
  void SetUp() override {
    name_ = fmt::format("@mesorig-watchdog-{}", ::getpid());
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name_.data(), name_.size());
    address.sun_path[0] = '\0';
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    ASSERT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address),
                     static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name_.size())),
              0);
  }
  void TearDown() override { ::close(fd_); }
  int Fed() {
    int count = 0;
    char buffer[64];
    while (::recv(fd_, buffer, sizeof(buffer), 0) > 0) ++count;
    return count;
  }
  std::string name_;
  int fd_ = -1;
  std::chrono::nanoseconds safety_{}, sequencer_{};  // how long they are silent
  const std::vector<ProgressSource> sources_ = {{"safety", [this] { return safety_; }},
                                                {"sequencer", [this] { return sequencer_; }}};
  Watchdog::HostClock::time_point now_{seconds(1000)};
};

TEST_F(WatchdogTest, FeedsFourTimesInItsLimit) {
  const ServiceManager manager(name_, seconds(8));
  Watchdog watchdog(manager, sources_);
  for (int i = 0; i < 80; ++i, now_ += milliseconds(100)) EXPECT_EQ(watchdog.Look(now_), "");
  EXPECT_EQ(Fed(), 4);
}

TEST_F(WatchdogTest, IsNotFedWhileASourceIsSilent) {
  const ServiceManager manager(name_, seconds(8));
  Watchdog watchdog(manager, sources_);
  sequencer_ = seconds(4);
  EXPECT_EQ(watchdog.Look(now_), "") << "half of the limit is permitted";
  EXPECT_EQ(Fed(), 1);
  sequencer_ = milliseconds(4001);
  safety_ = seconds(5);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(watchdog.Look(now_ += milliseconds(100)), "safety");
  EXPECT_EQ(Fed(), 0) << "systemd kills it";
  safety_ = {};
  EXPECT_EQ(watchdog.Look(now_), "sequencer");
  sequencer_ = {};
  EXPECT_EQ(watchdog.Look(now_), "");
  EXPECT_EQ(Fed(), 1) << "it came back in time";
}

TEST_F(WatchdogTest, WithoutSystemdItOnlyLooks) {
  const ServiceManager manager(name_, std::nullopt);
  Watchdog watchdog(manager, sources_);
  safety_ = seconds(16);
  EXPECT_EQ(watchdog.Look(now_), "safety");
  EXPECT_EQ(Fed(), 0);
}

}  // namespace
}  // namespace mesorig::daemon
