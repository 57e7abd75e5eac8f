#include "protocol/base/service_manager.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace mesorig {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

// systemd's end.
class Listener {
 public:
  explicit Listener(const std::string& name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<sockaddr*>(&address),
                     static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())),
              0);
  }
  ~Listener() { ::close(fd_); }
  std::string Next() {
    char buffer[4096];
    const ssize_t n = ::recv(fd_, buffer, sizeof(buffer), 0);
    return n < 0 ? "nothing" : std::string(buffer, static_cast<size_t>(n));
  }

 private:
  int fd_ = -1;
};

std::string Name(std::string_view kind) {
  return fmt::format("{}-{}", kind, ::getpid());
}

TEST(ServiceManager, SpeaksTheProtocolOfSystemd) {
  for (const std::string& name : {"@" + Name("mesorig-notify"), "/tmp/" + Name("mesorig-notify")}) {
    Listener systemd(name);
    const ServiceManager manager(name, std::chrono::seconds(10));
    EXPECT_EQ(manager.Ready("serving"), OkStatus());
    EXPECT_EQ(systemd.Next(), "READY=1\nSTATUS=serving");
    EXPECT_EQ(manager.Alive(), OkStatus());
    EXPECT_EQ(systemd.Next(), "WATCHDOG=1");
    EXPECT_EQ(manager.Reloading(), OkStatus());
    EXPECT_THAT(systemd.Next(), StartsWith("RELOADING=1\nMONOTONIC_USEC="));
    EXPECT_EQ(manager.Say("session a\nREADY=1"), OkStatus());
    EXPECT_EQ(systemd.Next(), "STATUS=session a READY=1") << "a status forges no message";
    EXPECT_EQ(manager.Stopping("SIGTERM"), OkStatus());
    EXPECT_EQ(systemd.Next(), "STOPPING=1\nSTATUS=SIGTERM");
    std::filesystem::remove(name);
  }
}

TEST(ServiceManager, TakesTheEnvironmentAsItIs) {
  ::setenv("NOTIFY_SOCKET", "relative", 1);
  ::setenv("WATCHDOG_USEC", "soon", 1);
  ::unsetenv("WATCHDOG_PID");
  EXPECT_FALSE(ServiceManager().present());
  EXPECT_FALSE(ServiceManager().watchdog().has_value());
  ::setenv("NOTIFY_SOCKET", "@nobody", 1);
  ::setenv("WATCHDOG_USEC", "30000000", 1);
  EXPECT_EQ(ServiceManager().watchdog(), std::chrono::seconds(30));
  EXPECT_TRUE(absl::IsUnavailable(ServiceManager().Alive())) << "nobody listens";
  ::setenv("WATCHDOG_PID", std::to_string(::getpid()).c_str(), 1);
  EXPECT_TRUE(ServiceManager().watchdog().has_value());
  ::setenv("WATCHDOG_PID", "1", 1);
  EXPECT_FALSE(ServiceManager().watchdog().has_value()) << "another process's";
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
  EXPECT_FALSE(ServiceManager().present());
  EXPECT_EQ(ServiceManager().Ready("alone"), OkStatus()) << "without systemd nothing is said";
}

}  // namespace
}  // namespace mesorig
