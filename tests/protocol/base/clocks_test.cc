#include "protocol/base/clocks.h"

#include <gtest/gtest.h>

#include <thread>

namespace mesorig {
namespace {

using std::chrono::milliseconds;

TEST(RigTime, SaturatesInsteadOfOverflowing) {
  EXPECT_EQ(FromSeconds(1.5), RigTime(milliseconds(1500)));
  EXPECT_EQ(FromSeconds(1e300), kNever);
  EXPECT_EQ(FromSeconds(-1e300), RigTime::min());
}

TEST(SystemRigClock, WaitsForThePredicateOrTheDeadline) {
  SystemRigClock clock;
  RigClock::Member member(clock, "test");
  const RigTime start = clock.Now();
  EXPECT_FALSE(clock.WaitFor(milliseconds(5), [] { return false; }));
  EXPECT_GE(clock.Now() - start, milliseconds(5));
  bool ready = false;
  std::thread other([&] { clock.Change([&] { ready = true; }); });
  EXPECT_TRUE(clock.WaitUntil(kNever, [&] { return ready; }));
  other.join();
}

TEST(RigQueue, HandsOverInOrderBetweenThreads) {
  SystemRigClock clock;
  RigQueue<int> queue(clock);
  std::thread producer([&] {
    for (int i = 0; i < 1000; ++i) queue.Push(i);
  });
  {
    RigClock::Member member(clock, "consumer");
    for (int i = 0; i < 1000; ++i) EXPECT_EQ(queue.Pop(kNever), i);
    EXPECT_EQ(queue.Pop(clock.Now()), std::nullopt);
  }
  producer.join();
}

TEST(RigClock, NamesThoseThatRun) {
  SystemRigClock clock;
  RigClock::Member member(clock, "safety");
  const auto runners = clock.Runners();
  ASSERT_EQ(runners.size(), 1u);
  EXPECT_EQ(runners[0].name, "safety");
}

}  // namespace
}  // namespace mesorig
