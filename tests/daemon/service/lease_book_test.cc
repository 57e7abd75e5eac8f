// Who may command, by the rules alone: time is a number.

#include "daemon/service/lease_book.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using Kind = LeaseState::Kind;
using Change = LeaseChange::Kind;

const Caller kAnna{Role::kOperator, "anna", "unix", ""};
const Caller kBert{Role::kOperator, "bert", "unix", ""};
const Caller kChief{Role::kAdministrator, "chief", "unix", ""};

LeaseTime At(double s) { return LeaseTime(milliseconds(static_cast<int64_t>(s * 1000))); }
std::string Text(const Status& status) { return std::string(Message(status)); }

TEST(LeaseBook, OneAtATimeAndItExpires) {
  LeaseBook book(0);
  const auto anna = book.Acquire(kAnna, milliseconds(0), false, At(0));
  ASSERT_TRUE(anna.ok());
  EXPECT_EQ(*anna, 1u);
  EXPECT_TRUE(book.Check(kAnna, 1, At(9.9)).ok());
  EXPECT_FALSE(book.Check(kBert, 1, At(9.9)).ok()) << "a token is its holder's alone";
  const auto bert = book.Acquire(kBert, milliseconds(0), false, At(9));
  EXPECT_TRUE(absl::IsFailedPrecondition(bert.status()));
  EXPECT_THAT(Text(bert.status()), HasSubstr("anna has control of the rig, for another 1.0 s"));
  // At the very instant it is over.
  EXPECT_TRUE(absl::IsFailedPrecondition(book.Check(kAnna, 1, At(10))));
  const auto later = book.Acquire(kBert, milliseconds(0), false, At(10));
  ASSERT_TRUE(later.ok());
  EXPECT_EQ(*later, 2u);
  EXPECT_THAT(Text(book.Check(kAnna, 1, At(10))), HasSubstr("lease 1 of anna is over: bert has"));
  EXPECT_FALSE(book.Renew(kAnna, 1, At(10)).ok());
  EXPECT_FALSE(book.Release(kAnna, 1, At(10)).ok());
}

TEST(LeaseBook, RenewingKeepsIt) {
  LeaseBook book(41);
  ASSERT_EQ(book.Acquire(kAnna, milliseconds(1000), false, At(0)).value_or(0), 42u);
  for (double t = 0.5; t < 20; t += 0.9) EXPECT_TRUE(book.Renew(kAnna, 42, At(t)).ok()) << t;
  EXPECT_EQ(book.State(At(19.5)).kind, Kind::kManual);
  EXPECT_FALSE(book.Renew(kAnna, 42, At(30)).ok());
  EXPECT_EQ(book.Expire(At(30)), std::nullopt);
}

TEST(LeaseBook, SpansHaveLimits) {
  LeaseBook book(0);
  for (const int64_t span : {-1, 1, 999, 60001}) {
    EXPECT_TRUE(
        absl::IsInvalidArgument(book.Acquire(kAnna, milliseconds(span), false, At(0)).status()));
  }
}

TEST(LeaseBook, OnesOwnFromElsewhereIsTakenOnlyWhenAsked) {
  LeaseBook book(0);
  ASSERT_TRUE(book.Acquire(kAnna, milliseconds(0), false, At(0)).ok());
  EXPECT_THAT(Text(book.Acquire(kAnna, milliseconds(0), false, At(1)).status()),
              HasSubstr("--take ends it there"));
  EXPECT_EQ(book.Acquire(kAnna, milliseconds(0), true, At(1)).value_or(0), 2u);
  EXPECT_FALSE(book.Check(kAnna, 1, At(1)).ok());
}

TEST(LeaseBook, AnAdministratorMayTake) {
  LeaseBook book(0);
  ASSERT_TRUE(book.Acquire(kAnna, milliseconds(0), false, At(0)).ok());
  EXPECT_TRUE(absl::IsPermissionDenied(book.Acquire(kBert, milliseconds(0), true, At(1)).status()));
  EXPECT_TRUE(
      absl::IsFailedPrecondition(book.Acquire(kChief, milliseconds(0), false, At(1)).status()));
  book.TakeChanges();
  EXPECT_EQ(book.Acquire(kChief, milliseconds(0), true, At(1)).value_or(0), 2u);
  const auto changes = book.TakeChanges();
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[0].kind, Change::kTaken);
  EXPECT_EQ(changes[0].holder, "anna");
  EXPECT_EQ(changes[0].requester, "chief");
  EXPECT_EQ(changes[0].token, 1u);
  EXPECT_EQ(changes[1].kind, Change::kAcquired);
}

TEST(LeaseBook, HandOverOnRequest) {
  LeaseBook book(0);
  EXPECT_THAT(Text(book.Request(kBert, At(0))), HasSubstr("nobody has control"));
  ASSERT_TRUE(book.Acquire(kAnna, milliseconds(0), false, At(0)).ok());
  EXPECT_FALSE(book.Request(kAnna, At(1)).ok());
  ASSERT_TRUE(book.Request(kBert, At(1)).ok());
  EXPECT_EQ(book.State(At(1)).requested_by, "bert");
  EXPECT_TRUE(book.Check(kAnna, 1, At(2)).ok()) << "asking takes nothing away";
  ASSERT_TRUE(book.Release(kAnna, 1, At(3)).ok());
  // It is his for a while, then anybody's.
  EXPECT_THAT(Text(book.Acquire(kAnna, milliseconds(0), false, At(4)).status()),
              HasSubstr("given up for bert"));
  LeaseBook late = book;
  EXPECT_EQ(book.Acquire(kBert, milliseconds(0), false, At(4)).value_or(0), 2u);
  EXPECT_EQ(late.Acquire(kAnna, milliseconds(0), false, At(13)).value_or(0), 2u);
  // One who lets it lapse reserves nothing.
  ASSERT_TRUE(book.Request(kAnna, At(5)).ok());
  EXPECT_EQ(book.Acquire(kChief, milliseconds(0), false, At(15)).value_or(0), 3u);
}

TEST(LeaseBook, ARunHoldsItsOwn) {
  LeaseBook book(0);
  ASSERT_TRUE(book.Acquire(kAnna, milliseconds(0), false, At(0)).ok());
  EXPECT_FALSE(book.BeginRun(kBert, 0, At(1)).ok()) << "somebody's hands are on it";
  EXPECT_FALSE(book.BeginRun(kAnna, 0, At(1)).ok()) << "without her token";
  const auto run = book.BeginRun(kAnna, 1, At(1));
  ASSERT_TRUE(run.ok());
  EXPECT_EQ(*run, 2u);
  // A closed laptop does not end the night; manual commands are refused meanwhile.
  EXPECT_EQ(book.Expire(At(1e6)), std::nullopt);
  EXPECT_EQ(book.State(At(1e6)).kind, Kind::kRun);
  EXPECT_FALSE(book.Check(kAnna, 1, At(2)).ok());
  EXPECT_FALSE(book.Check(kAnna, 2, At(2)).ok()) << "the run's token is nobody's";
  EXPECT_THAT(Text(book.Acquire(kChief, milliseconds(0), true, At(2)).status()),
              HasSubstr("a plan that anna began"));
  EXPECT_FALSE(book.BeginRun(kAnna, 0, At(2)).ok());
  EXPECT_FALSE(book.Request(kBert, At(2)).ok());
  book.EndRun(1);
  EXPECT_EQ(book.State(At(3)).kind, Kind::kRun);
  book.EndRun(2);
  EXPECT_EQ(book.State(At(3)).kind, Kind::kFree);
  EXPECT_EQ(book.BeginRun(kBert, 0, At(3)).value_or(0), 3u) << "free: no token is needed";
}

// Two clients, an administrator and plans do anything at any time: never two who may command, and
// tokens only grow.
TEST(LeaseBook, RandomWalks) {
  std::mt19937 random(5);
  const Caller callers[] = {kAnna, kBert, kChief};
  for (int walk = 0; walk < 200; ++walk) {
    LeaseBook book(random() % 1000);
    std::vector<std::pair<const Caller*, uint64_t>> given;  // every token ever
    uint64_t newest = book.State(At(0)).token, run = 0;
    double t = 0;
    for (int step = 0; step < 200; ++step) {
      t += static_cast<double>(random() % 4000) / 1000;
      const Caller& caller = callers[random() % 3];
      const uint64_t token = given.empty() ? 0 : given[random() % given.size()].second;
      switch (random() % 7) {
        case 0:
        case 1: {
          const auto got = book.Acquire(caller, milliseconds(0), random() % 2 == 0, At(t));
          if (!got.ok()) break;
          ASSERT_GT(*got, newest);
          given.emplace_back(&caller, newest = *got);
          break;
        }
        case 2:
          (void)book.Renew(caller, token, At(t));
          break;
        case 3:
          (void)book.Release(caller, token, At(t));
          break;
        case 4:
          (void)book.Request(caller, At(t));
          break;
        case 5: {
          const auto got = book.BeginRun(caller, random() % 2 == 0 ? token : 0, At(t));
          if (!got.ok()) break;
          ASSERT_GT(*got, newest);
          newest = run = *got;
          break;
        }
        default:
          book.EndRun(run);
      }
      int may = 0;
      for (const auto& [who, each] : given) {
        for (const Caller& any : callers) {
          if (!book.Check(any, each, At(t)).ok()) continue;
          ++may;
          ASSERT_EQ(any.name, who->name);
          ASSERT_EQ(each, newest);
        }
      }
      ASSERT_EQ(may, book.State(At(t)).kind == Kind::kManual ? 1 : 0);
    }
  }
}

}  // namespace
}  // namespace mesorig::daemon
