#include "daemon/service/stop_door.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <future>

#include "protocol/wire/stop_line.h"
#include "tests/fixtures/dial.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

class StopDoorTest : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/stop_door_XXXXXX";
    ASSERT_NE(::mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override {
    door_.reset();
    std::filesystem::remove_all(folder_);
  }
  void Open(StopDoorOptions options = {}) {
    auto door = StopDoor::Open(socket(), std::move(options), [this](const auto& orders) {
      {
        const std::lock_guard lock(mutex_);
        ++stops_;
        for (const auto& order : orders) reasons_.push_back(order.reason);
      }
      if (hold_.valid()) hold_.wait();
      return result_;
    });
    ASSERT_TRUE(door.ok()) << door.status();
    door_ = *std::move(door);
  }
  std::filesystem::path socket() const { return wire::StopSocket(folder_); }
  std::vector<std::string> Reasons() {
    const std::lock_guard lock(mutex_);
    return reasons_;
  }
  // Whatever the door says to these bytes until it closes.
  std::string Say(std::string_view bytes) {
    const int fd = test::DialUnix(socket().string());
    EXPECT_GE(fd, 0);
    EXPECT_EQ(::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
    std::string said;
    char buffer[256];
    for (ssize_t got; (got = ::recv(fd, buffer, sizeof(buffer), 0)) > 0;) {
      said.append(buffer, static_cast<size_t>(got));
    }
    ::close(fd);
    return said;
  }

  std::filesystem::path folder_;
  std::mutex mutex_;
  std::vector<std::string> reasons_;
  int stops_ = 0;
  std::shared_future<void> hold_;
  Status result_;
  std::unique_ptr<StopDoor> door_;
};

TEST_F(StopDoorTest, StopsAndSaysWhatCameOfIt) {
  Open();
  EXPECT_EQ(wire::SayStop(socket(), "smoke"), OkStatus());
  EXPECT_THAT(Reasons(), ::testing::ElementsAre("smoke"));
  result_ = Unavailable("lamps: no answer\nat all");
  const Status said = wire::SayStop(socket(), "");
  EXPECT_THAT(std::string(Message(said)), HasSubstr("lamps: no answer at all"));
  door_.reset();
  EXPECT_TRUE(absl::IsNotFound(wire::SayStop(socket(), "late"))) << "the socket is gone";
}

TEST_F(StopDoorTest, WhoAsksWhileOneIsCarriedOutGetsOneToo) {
  std::promise<void> go;
  hold_ = go.get_future().share();
  Open();
  auto first = std::async(std::launch::async, [&] { return wire::SayStop(socket(), "first"); });
  while (Reasons().empty()) std::this_thread::yield();
  std::vector<std::future<Status>> others;
  for (int i = 0; i < 20; ++i) {
    others.push_back(
        std::async(std::launch::async, [&] { return wire::SayStop(socket(), "other"); }));
  }
  go.set_value();
  EXPECT_EQ(first.get(), OkStatus());
  for (auto& other : others) EXPECT_EQ(other.get(), OkStatus());
  EXPECT_EQ(Reasons().size(), 21u);
}

TEST_F(StopDoorTest, GuestsThatSayNothingAreInNobodysWay) {
  StopDoorOptions options;
  options.connections = 8;
  Open(options);
  std::vector<int> silent;
  for (int i = 0; i < 100; ++i) silent.push_back(test::DialUnix(socket().string()));
  EXPECT_EQ(wire::SayStop(socket(), "still"), OkStatus());
  EXPECT_THAT(Reasons(), ::testing::ElementsAre("still"));
  for (const int fd : silent) ::close(fd);
}

TEST_F(StopDoorTest, WhatIsNoStopIsRefused) {
  StopDoorOptions options;
  options.patience = std::chrono::milliseconds(100);
  Open(options);
  EXPECT_THAT(Say("start\n"), HasSubstr("error"));
  EXPECT_THAT(Say(std::string(4000, 'x')), HasSubstr("error"));
  EXPECT_THAT(Say("sto"), HasSubstr("error nothing was said"));
  EXPECT_TRUE(Reasons().empty());
  EXPECT_EQ(Say("stop\nand more"), "ok\n");
}

TEST_F(StopDoorTest, AGroupThatIsNotThereIsSaid) {
  StopDoorOptions options;
  options.groups = {"no-such-group-here"};
  const auto door = StopDoor::Open(socket(), options, [](const auto&) { return OkStatus(); });
  EXPECT_TRUE(absl::IsNotFound(door.status())) << door.status();
}

}  // namespace
}  // namespace mesorig::daemon
