// What docs/lockstep.md says under "When somebody fails", in one process.

#include "protocol/sim_wire/sim_server.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <thread>
#include <vector>

#include "protocol/base/bytes.h"
#include "protocol/sim_wire/sim_link.h"

namespace mesorig::sim_wire {
namespace {

using std::chrono::milliseconds;

// Ticks every `period` of rig time, and says so only when `loud`.
class Ticker final : public SimDevice {
 public:
  std::string name() const override { return "ticker"; }
  void Command(RigTime now, std::string_view, Outbox&) override { commanded_at = now; }
  StatusOr<std::string> Query(RigTime, std::string_view text, Outbox&) override {
    if (text == "fail") return InvalidArgument("told to fail");
    return std::to_string(ticks.load());
  }
  RigTime NextEvent() const override { return period == kNever ? kNever : next_; }
  void RunEvent(RigTime now, Outbox& out) override {
    ++ticks;
    next_ = now + period;
    const auto busy_until = std::chrono::steady_clock::now() + busy;
    while (std::chrono::steady_clock::now() < busy_until) std::this_thread::yield();
    if (loud) out.Send("tick");
  }
  Status Inject(RigTime, std::string_view text, Outbox& out) override {
    if (text != "shout") return InvalidArgument("ticker does not know \"{}\"", text);
    out.Send("shout");
    return OkStatus();
  }
  RigTime period = kNever;
  bool loud = true;
  milliseconds busy{0};  // host time that each tick takes to compute
  std::atomic<int> ticks{0};
  std::atomic<RigTime> commanded_at{RigTime(-1)};

 private:
  RigTime next_{milliseconds(10)};
};

class SimServerTest : public ::testing::Test {
 protected:
  void Start(milliseconds silence_limit = milliseconds(5000)) {
    dir_ = std::filesystem::temp_directory_path() / fmt::format("mesorig-server-{}", ::getpid());
    std::filesystem::create_directories(dir_);
    std::filesystem::remove(dir_ / "s");
    SimServerOptions options;
    options.silence_limit = silence_limit;
    server_ = std::make_unique<SimServer>(Listen(dir_ / "s").value(),
                                          std::vector<SimDevice*>{&ticker_}, options);
    thread_ = std::thread([this] { EXPECT_TRUE(server_->Run().ok()); });
  }
  void StopServer() {
    if (!thread_.joinable()) return;
    server_->Stop();
    thread_.join();
    server_.reset();
  }
  void TearDown() override {
    StopServer();
    std::filesystem::remove_all(dir_);
  }
  std::unique_ptr<SimLink> Link(SimLinkOptions options = {}) {
    return SimLink::Connect("unix:" + (dir_ / "s").string(), options).value();
  }
  // Host time within which a thing that must happen soon has to happen.
  template <typename F>
  static bool Eventually(F condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::yield();
    }
    return true;
  }
  std::filesystem::path dir_;
  Ticker ticker_;
  std::unique_ptr<SimServer> server_;
  std::thread thread_;
};

// A rig on real buses: its clock is the system's, and what is simulated lives beside it.
TEST_F(SimServerTest, InRealTimeSeveralClientsShareTheDevices) {
  ticker_.period = milliseconds(20);
  Start();
  SystemRigClock clock;
  SimLinkOptions live;
  live.live = &clock;
  const auto one = Link(live), two = Link(live);
  std::vector<RigTime> heard[2];
  for (int i = 0; i < 2; ++i) {
    (i == 0 ? one : two)->Subscribe(0, [&heard, i](RigTime now, const std::string&) {
      heard[i].push_back(now);
    });
  }
  const auto count = [&](int i) {
    size_t n = 0;
    clock.Read([&] { n = heard[i].size(); });
    return n;
  };
  ASSERT_TRUE(Eventually([&] { return count(0) >= 10 && count(1) >= 10; })) << "nobody moves time";
  clock.Read([&] {
    EXPECT_TRUE(std::is_sorted(heard[0].begin(), heard[0].end()));
    EXPECT_GE(heard[0][9] - heard[0][0], milliseconds(100)) << "faster than the wall clock";
  });
  ASSERT_TRUE(one->Post(0, "now").ok());
  ASSERT_TRUE(Eventually([&] { return ticker_.commanded_at.load() >= milliseconds(100); }));
  EXPECT_TRUE(two->Query(0, "").ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(two->Query(0, "fail").status()));
  const Status lockstep = SimLink::Connect("unix:" + (dir_ / "s").string()).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(lockstep));
  EXPECT_NE(Message(lockstep).find("wall clock"), std::string_view::npos) << lockstep;
}

TEST_F(SimServerTest, InRealTimeCommandsMeetThePresentHoweverLongDevicesCompute) {
  ticker_.period = milliseconds(200);
  ticker_.busy = milliseconds(60);
  Start();
  SystemRigClock clock;
  SimLinkOptions live;
  live.live = &clock;
  const auto link = Link(live);
  const auto began = std::chrono::steady_clock::now();
  const RigTime simulated = link->welcome().now;
  for (int i = 0; i < 20; ++i) {
    const auto posted = std::chrono::steady_clock::now() - began;
    ASSERT_TRUE(link->Post(0, "").ok());
    ASSERT_TRUE(link->Query(0, "").ok());  // after it
    // As an exposure: not before its trigger.
    ASSERT_GE(ticker_.commanded_at.load() - simulated, posted - milliseconds(1)) << i;
  }
}

TEST_F(SimServerTest, NobodyJoinsARigInLockstep) {
  Start();
  const auto rig = Link();
  SystemRigClock clock;
  SimLinkOptions live;
  live.live = &clock;
  const Status refused = SimLink::Connect("unix:" + (dir_ / "s").string(), live).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(refused));
  EXPECT_NE(Message(refused).find("another daemon"), std::string_view::npos) << refused;
}

TEST_F(SimServerTest, TimeStandsStillWithoutActivityAndJumpsWithOne) {
  Start();
  auto link = Link();
  RigClock::Member member(*link, "test");
  EXPECT_EQ(link->Now(), RigTime(0));
  RigClock::Activity activity(*link, Pace::kFree);
  link->SleepFor(std::chrono::hours(1));
  EXPECT_EQ(link->Now(), RigTime(std::chrono::hours(1)));
}

TEST_F(SimServerTest, AdvanceReturnsEarlyOnOutput) {
  ticker_.period = milliseconds(10);
  Start();
  auto link = Link();
  RigQueue<std::string> outputs(*link);
  link->Subscribe(0, [&](RigTime, std::string text) { outputs.PushInsideChange(std::move(text)); });
  RigClock::Member member(*link, "test");
  RigClock::Activity activity(*link, Pace::kFree);
  EXPECT_EQ(outputs.Pop(milliseconds(25)), "tick");
  EXPECT_EQ(link->Now(), RigTime(milliseconds(10)));
  EXPECT_EQ(outputs.Pop(milliseconds(15)), std::nullopt);
  EXPECT_EQ(link->Now(), RigTime(milliseconds(15)));
}

TEST_F(SimServerTest, QueriesFailWithTheDevicesReason) {
  Start();
  auto link = Link();
  EXPECT_EQ(link->Query(0, "").value(), "0");
  const auto failed = link->Query(0, "fail");
  ASSERT_FALSE(failed.ok());
  EXPECT_NE(Message(failed.status()).find("told to fail"), std::string_view::npos);
}

TEST_F(SimServerTest, RunsOnByItselfAtOnceWhenTheSocketCloses) {
  ticker_.period = milliseconds(10);
  ticker_.loud = false;
  Start();
  Link().reset();
  EXPECT_TRUE(Eventually([&] { return ticker_.ticks > 3; }));
  auto again = Link();  // and comes back to lockstep
  const RigTime then = again->Now();
  EXPECT_GE(then, RigTime(milliseconds(40)));
  const int ticks = ticker_.ticks;
  EXPECT_EQ(again->Query(0, "").value(), std::to_string(ticks));
  EXPECT_EQ(again->Now(), then);
}

TEST_F(SimServerTest, RunsOnAndMarksTheSessionWhenTheDaemonFallsSilent) {
  ticker_.period = milliseconds(10);
  ticker_.loud = false;
  Start(milliseconds(50));
  SimLinkOptions never_alive;
  never_alive.alive_period = std::chrono::hours(1);
  auto link = Link(never_alive);
  RigClock::Member member(*link, "test");
  EXPECT_TRUE(link->deterministic());
  EXPECT_TRUE(Eventually([&] { return ticker_.ticks > 3; }));
  RigClock::Activity activity(*link, Pace::kFree);
  link->SleepFor(std::chrono::seconds(10));
  EXPECT_FALSE(link->deterministic());
}

// The daemon is not silent while the simulator is too busy to listen.
TEST_F(SimServerTest, ABusySimulatorIsNotASilentDaemon) {
  ticker_.period = milliseconds(10);
  ticker_.busy = milliseconds(250);
  Start(milliseconds(100));
  SimLinkOptions options;
  options.alive_period = milliseconds(20);
  const auto link = Link(options);
  RigClock::Member member(*link, "test");
  RigClock::Activity activity(*link, Pace::kFree);
  link->SleepFor(milliseconds(35));
  EXPECT_EQ(ticker_.ticks, 3);
  EXPECT_TRUE(link->deterministic());
}

TEST_F(SimServerTest, DeadlinesStillComeWhenTheSimulatorIsGone) {
  Start();
  auto link = Link();
  RigClock::Member member(*link, "test");
  RigClock::Activity activity(*link, Pace::kFree);
  StopServer();
  EXPECT_FALSE(link->WaitFor(milliseconds(30), [] { return false; }));
  EXPECT_TRUE(Eventually([&] { return !link->health().ok(); }));
  EXPECT_FALSE(link->Query(0, "").ok());
  EXPECT_FALSE(link->Post(0, "").ok());
}

TEST_F(SimServerTest, RealTimePaceDoesNotOutrunTheWallClock) {
  Start();
  auto link = Link();
  RigClock::Member member(*link, "test");
  RigClock::Activity activity(*link, Pace::kRealTime);
  const auto start = std::chrono::steady_clock::now();
  link->SleepFor(milliseconds(100));
  EXPECT_GE(std::chrono::steady_clock::now() - start, milliseconds(79));
}

TEST_F(SimServerTest, InjectionIsSeenWhileTimeStandsStill) {
  Start();
  auto link = Link();
  std::atomic<bool> seen{false};
  link->Subscribe(0, [&](RigTime, std::string text) { seen = std::string_view(text).starts_with("shout"); });
  Fd injector = Connect(dir_ / "s").value();
  std::string bytes;
  AppendMessage({MessageType::kHello, 0, 0, {},
                 ByteWriter().Put(kProtocolVersion).Put<uint8_t>(1).Take()}, bytes);
  AppendMessage({MessageType::kInject, 0, 1, {}, "ticker shout"}, bytes);
  ASSERT_TRUE(SendAll(injector.get(), bytes, 1000).ok());
  EXPECT_TRUE(Eventually([&] { return seen.load(); }));
  EXPECT_EQ(link->Now(), RigTime(0));
}

TEST_F(SimServerTest, OnlyOneDaemonDrives) {
  Start();
  auto link = Link();
  const auto second = SimLink::Connect("unix:" + (dir_ / "s").string());
  ASSERT_FALSE(second.ok());
  EXPECT_NE(Message(second.status()).find("another daemon"), std::string_view::npos);
}

TEST_F(SimServerTest, NamesWhoHoldsTime) {
  Start();
  auto link = Link();
  RigClock::Member member(*link, "sequencer");
  ASSERT_EQ(link->Runners().size(), 1u);
  EXPECT_EQ(link->Runners()[0].name, "sequencer");
}

TEST_F(SimServerTest, DropsAClientThatSpeaksGarbage) {
  Start();
  Fd rogue = Connect(dir_ / "s").value();
  ASSERT_TRUE(SendAll(rogue.get(), std::string(64, '\xff'), 1000).ok());
  char byte;
  EXPECT_EQ(ReceiveSome(rogue.get(), &byte, 1).value_or(0), 0u);
  EXPECT_EQ(Link()->Query(0, "").value(), "0");
}

}  // namespace
}  // namespace mesorig::sim_wire
