// Two processes, one virtual time: a simulator with toy devices that speak at pseudo-random
// instants and interact, and a daemon with members that post, query, sleep, wait for outputs and
// hand work to each other. The same seed must give the same history, ten times out of ten, also
// while another process burns both cores (docs/lockstep.md).

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <thread>

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "protocol/sim_wire/sim_link.h"
#include "protocol/sim_wire/sim_server.h"

namespace mesorig::sim_wire {
namespace {

using std::chrono::microseconds;

uint64_t Mix(uint64_t x) {  // SplitMix64
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

// A device whose state mixes all it was told with when; answers after a delay that depends on it,
// and ticks by itself now and then. It reads its left neighbour's state as of before the instant.
class ToyDevice final : public SimDevice {
 public:
  ToyDevice(int number, uint64_t seed) : number_(number), state_(Mix(seed + number)) {}
  std::string name() const override { return fmt::format("toy{}", number_); }
  void SetNeighbour(const ToyDevice* neighbour) { neighbour_ = neighbour; }

  void Command(RigTime now, std::string_view payload, Outbox&) override {
    Absorb(now, Sum(payload));
    next_ = std::min(next_, now + microseconds(1 + state_ % 900));
  }
  StatusOr<std::string> Query(RigTime now, std::string_view payload, Outbox&) override {
    Absorb(now, Sum(payload));
    return ByteWriter().Put(state_).Take();
  }
  RigTime NextEvent() const override { return next_; }
  void RunEvent(RigTime now, Outbox& out) override {
    Absorb(now, neighbour_ != nullptr ? neighbour_->StateBefore(now) : 0);
    out.Send(ByteWriter().Put(state_).Take());
    next_ = state_ % 3 == 0 ? now + microseconds(500 + state_ % 7000) : kNever;
  }
  uint64_t StateBefore(RigTime now) const { return changed_ < now ? state_ : previous_; }

 private:
  static uint64_t Sum(std::string_view payload) {
    uint64_t sum = 0;
    for (const char c : payload) sum = Mix(sum + static_cast<unsigned char>(c));
    return sum;
  }
  void Absorb(RigTime now, uint64_t value) {
    if (changed_ < now) previous_ = state_;
    changed_ = now;
    state_ = Mix(state_ ^ value ^ static_cast<uint64_t>(now.count()));
  }
  const int number_;
  uint64_t state_, previous_ = 0;
  RigTime changed_{-1}, next_ = kNever;
  const ToyDevice* neighbour_ = nullptr;
};

constexpr int kDevices = 6;
constexpr int kRounds = 250;

[[noreturn]] void SimulatorProcess(const std::filesystem::path& socket, uint64_t seed) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::vector<std::unique_ptr<ToyDevice>> toys;
  std::vector<SimDevice*> devices;
  for (int i = 0; i < kDevices; ++i) {
    toys.push_back(std::make_unique<ToyDevice>(i, seed));
    devices.push_back(toys.back().get());
  }
  for (int i = 0; i < kDevices; ++i) toys[i]->SetNeighbour(toys[(i + 1) % kDevices].get());
  auto listener = Listen(socket);
  if (!listener.ok()) ::_exit(1);
  SimServer server(std::move(*listener), devices, {});
  ::_exit(server.Run().ok() ? 0 : 1);
}

pid_t StartSimulator(const std::filesystem::path& socket, uint64_t seed) {
  std::filesystem::remove(socket);
  const pid_t pid = ::fork();
  if (pid == 0) SimulatorProcess(socket, seed);
  while (!std::filesystem::exists(socket)) std::this_thread::yield();
  return pid;
}

StatusOr<std::unique_ptr<SimLink>> ConnectTo(const std::filesystem::path& socket) {
  for (;;) {  // the socket exists a moment before it listens
    auto link = SimLink::Connect("unix:" + socket.string());
    if (link.ok() || !absl::IsUnavailable(link.status())) return link;
  }
}

// One member a device: its history is what it saw and when.
struct Worker {
  explicit Worker(SimLink& link) : outputs(link), handed(link) {}
  RigQueue<std::pair<RigTime, std::string>> outputs;
  RigQueue<uint64_t> handed;  // from the worker to the left
  ByteWriter history;
};

void Work(SimLink& link, std::vector<std::unique_ptr<Worker>>& workers, int i, uint64_t seed) {
  Worker& me = *workers[i];
  const auto device = static_cast<uint16_t>(i);
  uint64_t random = Mix(seed * 31 + i);
  for (int round = 0; round < kRounds; ++round) {
    random = Mix(random);
    switch (random % 5) {
      case 0:
        ASSERT_TRUE(link.Post(device, ByteWriter().Put(random).Take()).ok());
        break;
      case 1: {
        const auto answer = link.Query(device, ByteWriter().Put(random).Take());
        ASSERT_TRUE(answer.ok());
        me.history.PutString(*answer);
        break;
      }
      case 2:
        link.SleepFor(microseconds(random % 3000));
        break;
      case 3:
        workers[(i + 1) % kDevices]->handed.Push(random);
        break;
      default:
        if (const auto work = me.handed.Pop(link.Now() + microseconds(random % 2000))) {
          me.history.Put(*work);
        }
    }
    if (const auto output = me.outputs.Pop(link.Now() + microseconds(random % 700))) {
      me.history.Put<int64_t>(output->first.count()).PutString(output->second);
    }
    me.history.Put<int64_t>(link.Now().count());
  }
}

std::string RunOnce(const std::filesystem::path& socket, uint64_t seed, RigTime* end) {
  const pid_t simulator = StartSimulator(socket, seed);
  std::string digest;
  {
    auto link = ConnectTo(socket).value();
    std::vector<std::unique_ptr<Worker>> workers;
    for (int i = 0; i < kDevices; ++i) {
      workers.push_back(std::make_unique<Worker>(*link));
      Worker* worker = workers.back().get();
      link->Subscribe(static_cast<uint16_t>(i), [worker](RigTime time, std::string payload) {
        worker->outputs.PushInsideChange({time, std::move(payload)});
      });
    }
    std::atomic<int> ready{0};
    std::atomic<bool> go{false};
    std::vector<std::thread> threads;
    for (int i = 0; i < kDevices; ++i) {
      threads.emplace_back([&, i] {
        RigClock::Member member(*link, fmt::format("worker {}", i));
        ++ready;
        while (!go) std::this_thread::yield();
        Work(*link, workers, i, seed);
      });
    }
    while (ready < kDevices) std::this_thread::yield();
    {
      RigClock::Activity activity(*link, Pace::kFree);
      go = true;
      for (std::thread& thread : threads) thread.join();
    }
    std::string all;
    for (const auto& worker : workers) all += worker->history.bytes();
    digest = FrameDigest(all);
    *end = link->Now();
    EXPECT_TRUE(link->deterministic());
    EXPECT_TRUE(link->health().ok());
  }
  ::kill(simulator, SIGTERM);
  ::waitpid(simulator, nullptr, 0);
  return digest;
}

class LockstepTorture : public ::testing::Test {
 protected:
  void SetUp() override {
    dir_ = std::filesystem::temp_directory_path() / fmt::format("mesorig-lockstep-{}", ::getpid());
    std::filesystem::create_directories(dir_);
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }
  std::filesystem::path dir_;
};

TEST_F(LockstepTorture, SameSeedSameHistoryTenTimes) {
  RigTime first_end{}, end{};
  const std::string first = RunOnce(dir_ / "s", 7, &first_end);
  EXPECT_GT(Seconds(first_end), 0.1);
  for (int i = 1; i < 10; ++i) {
    EXPECT_EQ(RunOnce(dir_ / "s", 7, &end), first) << "run " << i;
    EXPECT_EQ(end, first_end);
  }
  EXPECT_NE(RunOnce(dir_ / "s", 8, &end), first) << "another seed must give another history";
}

TEST_F(LockstepTorture, AlsoWhileAnotherProcessBurnsBothCores) {
  RigTime first_end{}, end{};
  const std::string first = RunOnce(dir_ / "s", 11, &first_end);
  std::vector<pid_t> burners;
  for (unsigned i = 0; i < std::max(2u, std::thread::hardware_concurrency()); ++i) {
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      for (std::atomic<uint64_t> x{0};; ++x) {
      }
    }
    burners.push_back(pid);
  }
  for (int i = 0; i < 10; ++i) EXPECT_EQ(RunOnce(dir_ / "s", 11, &end), first) << "run " << i;
  for (const pid_t pid : burners) {
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
  }
}

}  // namespace
}  // namespace mesorig::sim_wire
