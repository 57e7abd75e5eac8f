#include "protocol/wire/listeners.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>

#include "protocol/base/mutex.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/channel.h"
#include "tests/fixtures/dial.h"

namespace mesorig::wire {
namespace {

namespace fs = std::filesystem;

class ListenersTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "mesorig-listen-XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    dir_ = name;
  }
  void TearDown() override {
    listeners_.Stop();
    for (const Connection& connection : taken_) ::close(connection.fd);
    fs::remove_all(dir_);
  }
  Listeners::Take Keep() {
    return [this](Connection&& connection) {
      MutexLock lock(mutex_);
      taken_.push_back(std::move(connection));
      came_.NotifyAll();
    };
  }
  std::vector<Connection> Await(size_t count) {
    MutexLock lock(mutex_);
    while (taken_.size() < count) came_.Wait(mutex_);
    return taken_;
  }
  fs::path dir_;
  Mutex mutex_;
  CondVar came_;
  std::vector<Connection> taken_ GUARDED_BY(mutex_);
  Listeners listeners_{ListenerLimits{8, 3}};
};

TEST_F(ListenersTest, TellsWhoComes) {
  ASSERT_TRUE(listeners_.AddUnix(dir_ / "s", 0600, std::nullopt, Keep()).ok());
  listeners_.Start();
  const int fd = test::DialUnix(dir_ / "s");
  const auto taken = Await(1);
  ASSERT_TRUE(taken[0].local.has_value());
  EXPECT_EQ(taken[0].local->uid, ::getuid());
  EXPECT_EQ(taken[0].local->gid, ::getgid());
  EXPECT_EQ(taken[0].local->pid, ::getpid());
  EXPECT_EQ(taken[0].from, fmt::format("uid {}", ::getuid()));
  ::close(fd);
}

TEST_F(ListenersTest, ASocketHasItsModeAndReplacesAStaleOne) {
  Listeners first;
  ASSERT_TRUE(first.AddUnix(dir_ / "s", 0600, std::nullopt, Keep()).ok());
  ASSERT_TRUE(listeners_.AddUnix(dir_ / "s", 0660, ::getgid(), Keep()).ok());
  struct stat status {};
  ASSERT_EQ(::stat((dir_ / "s").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0660u);
  EXPECT_FALSE(listeners_.AddUnix(dir_ / std::string(120, 'x'), 0600, std::nullopt, Keep()).ok());
  EXPECT_FALSE(listeners_.AddUnix(dir_ / "no" / "s", 0600, std::nullopt, Keep()).ok());
}

TEST_F(ListenersTest, OneMayHaveSoManyAtATime) {
  ASSERT_TRUE(listeners_.AddUnix(dir_ / "s", 0600, std::nullopt, Keep()).ok());
  listeners_.Start();
  std::vector<int> fds;
  for (int i = 0; i < 3; ++i) fds.push_back(test::DialUnix(dir_ / "s"));
  Await(3);
  const int refused = test::DialUnix(dir_ / "s");
  char byte = 0;
  EXPECT_EQ(::read(refused, &byte, 1), 0) << "closed at once";
  // The taker has closed one: there is room again.
  {
    MutexLock lock(mutex_);
    ::close(taken_[0].fd);
    taken_.erase(taken_.begin());
  }
  fds.push_back(test::DialUnix(dir_ / "s"));
  EXPECT_EQ(Await(3).size(), 3u);
  ::close(refused);
  for (const int fd : fds) ::close(fd);
}

TEST_F(ListenersTest, AnAddressIsHostAndPort) {
  for (const char* wrong : {"", "7443", ":7443", "localhost:", "localhost", "127.0.0.1:x"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(listeners_.AddTcp(wrong, Keep()).status())) << wrong;
  }
  const auto address = listeners_.AddTcp("127.0.0.1:0", Keep());
  ASSERT_TRUE(address.ok()) << address.status();
  EXPECT_TRUE(address->starts_with("127.0.0.1:"));
  EXPECT_NE(*address, "127.0.0.1:0");
  EXPECT_TRUE(absl::IsFailedPrecondition(listeners_.AddTcp(*address, Keep()).status()));
}

TEST_F(ListenersTest, UsersAndGroupsHaveNames) {
  EXPECT_EQ(UserName(0), "root");
  EXPECT_EQ(UserName(4'000'000'000u), "uid 4000000000");
  EXPECT_EQ(GroupNamed("root").value(), 0u);
  EXPECT_TRUE(absl::IsNotFound(GroupNamed("no such group").status()));
}

TEST_F(ListenersTest, AClientTakesTheSocketWithTheMostRightsThatItMayOpen) {
  auto endpoint = PublishedEndpoint::Claim(dir_, "d").value();
  ASSERT_TRUE(listeners_.AddUnix(dir_ / "low", 0600, std::nullopt, Keep()).ok());
  const std::string low = "unix:" + (dir_ / "low").string();
  ASSERT_TRUE(
      endpoint.Publish(fmt::format("high unix:{}/gone\nlow {}\n", dir_.string(), low)).ok());
  EXPECT_EQ(LocalEndpoint(dir_, "d").value(), low);
  EXPECT_EQ(LocalEndpoint(dir_, "d", "low").value(), low);
  EXPECT_FALSE(LocalEndpoint(dir_, "d", "other").ok());
  ASSERT_TRUE(endpoint.Publish(fmt::format("high unix:{}/gone\n", dir_.string())).ok());
  EXPECT_TRUE(absl::IsPermissionDenied(LocalEndpoint(dir_, "d").status()));
  ASSERT_TRUE(endpoint.Publish("unix:/one/for/all").ok());
  EXPECT_EQ(LocalEndpoint(dir_, "d", "low").value(), "unix:/one/for/all");
  EXPECT_TRUE(absl::IsUnavailable(LocalEndpoint(dir_, "nobody").status()));
}

}  // namespace
}  // namespace mesorig::wire
