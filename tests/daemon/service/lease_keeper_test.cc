// The lease with hooks, threads, and a daemon that begins again.

#include "daemon/service/lease_keeper.h"

#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <future>
#include <thread>

#include "protocol/base/file_writer.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;

const Caller kAnna{Role::kOperator, "anna", "unix", ""};
const Caller kBert{Role::kOperator, "bert", "unix", ""};

class LeaseKeeperTest : public ::testing::Test {
 protected:
  // What a device layer knows: the newest token, and whether it may command.
  struct Fence {
    uint64_t newest = 0;
    bool open = false;
    int closed = 0;
  };
  std::unique_ptr<LeaseKeeper> Open() {
    LeaseHooks hooks;
    hooks.admit = [this](uint64_t token) {
      const MutexLock lock(mutex_);
      EXPECT_GT(token, fence_.newest);
      fence_.newest = token;
      fence_.open = true;
    };
    hooks.close = [this](uint64_t newest) {
      const MutexLock lock(mutex_);
      EXPECT_GE(newest, fence_.newest);
      fence_.newest = newest;
      fence_.open = false;
      ++fence_.closed;
    };
    hooks.changed = [this](const LeaseChange& change) {
      const MutexLock lock(mutex_);
      log_ += fmt::format("{} {} {};", Name(change.kind), change.holder, change.token);
    };
    hooks.now = [this] { return LeaseTime(milliseconds(now_ms_)); };
    auto keeper = LeaseKeeper::Open(folder_.path(), hooks);
    EXPECT_TRUE(keeper.ok()) << keeper.status();
    return keeper.ok() ? *std::move(keeper) : nullptr;
  }
  Fence fence() {
    const MutexLock lock(mutex_);
    return fence_;
  }
  std::string log() {
    const MutexLock lock(mutex_);
    return log_;
  }

  TemporaryFolder folder_;
  std::atomic<int64_t> now_ms_{0};
  Mutex mutex_;
  Fence fence_ GUARDED_BY(mutex_);
  std::string log_ GUARDED_BY(mutex_);
};

TEST_F(LeaseKeeperTest, TheFenceFollowsTheLease) {
  auto keeper = Open();
  const uint64_t anna = keeper->Acquire(kAnna, milliseconds(0), false).value_or(0);
  EXPECT_TRUE(fence().open);
  EXPECT_EQ(fence().newest, anna);
  now_ms_ = 10'000;
  keeper->Look();
  EXPECT_FALSE(fence().open);
  EXPECT_EQ(log(), fmt::format("acquired anna {0};expired anna {0};", anna));
  const uint64_t bert = keeper->Acquire(kBert, milliseconds(0), false).value_or(0);
  EXPECT_GT(bert, anna);
  EXPECT_FALSE(keeper->Check(kAnna, anna).ok());
  EXPECT_TRUE(keeper->Check(kBert, bert).ok());
  EXPECT_TRUE(keeper->Release(kBert, bert).ok());
  EXPECT_EQ(fence().closed, 2);
}

// The late command itself finds that the lease is over, before any thread looked.
TEST_F(LeaseKeeperTest, ACheckEndsWhatIsOver) {
  auto keeper = Open();
  const uint64_t anna = keeper->Acquire(kAnna, milliseconds(0), false).value_or(0);
  now_ms_ = 10'000;
  EXPECT_FALSE(keeper->Check(kAnna, anna).ok());
  EXPECT_FALSE(fence().open);
}

TEST_F(LeaseKeeperTest, ARunClosesTheFence) {
  auto keeper = Open();
  const uint64_t anna = keeper->Acquire(kAnna, milliseconds(0), false).value_or(0);
  EXPECT_FALSE(keeper->BeginRun(kBert, 0).ok());
  EXPECT_TRUE(fence().open);
  const auto run = keeper->BeginRun(kAnna, anna);
  ASSERT_TRUE(run.ok());
  EXPECT_FALSE(fence().open);
  EXPECT_EQ(fence().newest, *run);
  now_ms_ = 1'000'000;
  keeper->Look();
  EXPECT_EQ(keeper->State().kind, LeaseState::Kind::kRun) << "it does not expire";
  keeper->EndRun(*run);
  EXPECT_EQ(keeper->State().kind, LeaseState::Kind::kFree);
}

TEST_F(LeaseKeeperTest, TokensGrowOverRestartsAndKills) {
  uint64_t last = 0;
  for (int life = 0; life < 5; ++life) {
    auto keeper = Open();
    EXPECT_FALSE(keeper->Check(kAnna, last).ok()) << "a lease does not outlive its daemon";
    for (int i = 0; i < 3; ++i) {
      const uint64_t token = keeper->Acquire(kAnna, milliseconds(0), true).value_or(0);
      ASSERT_GT(token, last);
      last = token;
    }
  }
}

TEST_F(LeaseKeeperTest, MoreTokensThanABlockHolds) {
  auto keeper = Open();
  uint64_t last = 0;
  for (int i = 0; i < 2500; ++i) {
    const uint64_t token = keeper->Acquire(kAnna, milliseconds(0), true).value_or(0);
    ASSERT_GT(token, last);
    last = token;
  }
  keeper.reset();
  keeper = Open();
  EXPECT_GT(keeper->Acquire(kAnna, milliseconds(0), true).value_or(0), last);
}

TEST_F(LeaseKeeperTest, ADamagedFileIsRefused) {
  for (const std::string text : {"", "x", "12", "12 \n", "-1\n", "99999999999999999999\n", "1\n2\n",
                                 "9223372036854775807\n"}) {
    std::ofstream(folder_.path() / kLeaseFile, std::ios::trunc) << text;
    EXPECT_TRUE(absl::IsInvalidArgument(LeaseKeeper::Open(folder_.path(), {}).status())) << text;
  }
  std::ofstream(folder_.path() / kLeaseFile, std::ios::trunc) << "12\n";
  EXPECT_EQ(Open()->Acquire(kAnna, milliseconds(0), false).value_or(0), 13u);
}

TEST_F(LeaseKeeperTest, ManyClientsRace) {
  auto keeper = Open();
  std::atomic<int> holders{0}, won{0};
  std::vector<std::thread> clients;
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      const Caller caller{Role::kOperator, fmt::format("client {}", c), "unix", ""};
      for (int i = 0; i < 200; ++i) {
        const auto token = keeper->Acquire(caller, milliseconds(0), false);
        if (!token.ok()) continue;
        ++won;
        EXPECT_EQ(++holders, 1);
        EXPECT_TRUE(keeper->Check(caller, *token).ok());
        --holders;
        EXPECT_TRUE(keeper->Release(caller, *token).ok());
      }
    });
  }
  for (auto& client : clients) client.join();
  EXPECT_GT(won, 0);
  EXPECT_FALSE(fence().open);
}

// By the real clock: the thread ends it by itself.
TEST(LeaseKeeper, ExpiresByItself) {
  TemporaryFolder folder;
  std::promise<void> closed;
  LeaseHooks hooks;
  hooks.close = [&](uint64_t) { closed.set_value(); };
  auto keeper = LeaseKeeper::Open(folder.path(), hooks);
  ASSERT_TRUE(keeper.ok());
  ASSERT_TRUE((*keeper)->Acquire(kAnna, milliseconds(1000), false).ok());
  closed.get_future().wait();
  EXPECT_EQ((*keeper)->State().kind, LeaseState::Kind::kFree);
}

}  // namespace
}  // namespace mesorig::daemon
