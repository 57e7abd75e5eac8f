#include "daemon/service/event_log.h"

#include <gtest/gtest.h>

#include <thread>

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;

void AppendNotes(EventLog& log, int from, int to) {
  for (int i = from; i <= to; ++i) {
    v1::Event event;
    event.set_note(std::to_string(i));
    log.Append(event);
  }
}

TEST(EventLog, ReplaysFromACursor) {
  EventLog log;
  EXPECT_TRUE(log.Read(0, "", milliseconds(0)).empty());
  AppendNotes(log, 1, 10);
  const auto all = log.Read(0, "", milliseconds(0));
  ASSERT_EQ(all.size(), 10u);
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(all[i].sequence(), i + 1u);
    EXPECT_EQ(all[i].note(), std::to_string(i + 1));
  }
  const auto rest = log.Read(7, "", milliseconds(0));
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(rest.front().sequence(), 8u);
  EXPECT_TRUE(log.Read(10, "", milliseconds(0)).empty());
}

TEST(EventLog, TellsWhatIsNoLongerKept) {
  EventLog log(4);
  AppendNotes(log, 1, 10);
  const auto events = log.Read(2, "", milliseconds(0));
  ASSERT_EQ(events.size(), 5u);
  ASSERT_TRUE(events[0].has_gap());
  EXPECT_EQ(events[0].gap().first(), 3u);
  EXPECT_EQ(events[0].gap().last(), 6u);
  EXPECT_FALSE(events[0].gap().other_life());
  EXPECT_EQ(events[0].sequence(), 6u);
  EXPECT_EQ(events[1].note(), "7");
  EXPECT_EQ(log.Read(6, "", milliseconds(0)).front().note(), "7");
}

// However small the log and whenever a reader comes: what it saw and what it was told is missing is
// everything, once and in order.
TEST(EventLog, GapsAndEventsAreEverything) {
  for (size_t kept = 1; kept < 12; ++kept) {
    EventLog log(kept, "a");
    uint64_t cursor = 0, accounted = 0;
    int next = 1;
    for (int round = 0; round < 41; ++round) {
      AppendNotes(log, next, next + (round * 7) % 13);
      next += (round * 7) % 13 + 1;
      if (round % 3 == 0) continue;
      for (const auto& event : log.Read(cursor, "a", milliseconds(0))) {
        if (event.has_gap()) {
          ASSERT_EQ(event.gap().first(), accounted + 1);
          accounted = event.gap().last();
        } else {
          ASSERT_EQ(event.sequence(), ++accounted);
        }
        cursor = event.sequence();
      }
    }
    EXPECT_EQ(accounted, log.last());
  }
}

TEST(EventLog, TellsACursorOfAnEarlierLife) {
  EventLog log;
  auto events = log.Read(500, "", milliseconds(0));
  ASSERT_EQ(events.size(), 1u);
  EXPECT_TRUE(events[0].gap().other_life());
  EXPECT_EQ(events[0].sequence(), 0u) << "the reader begins anew";
  AppendNotes(log, 1, 2);
  // Its number is one of this life too: the life tells.
  for (const uint64_t after : {1u, 2u, 500u}) {
    events = log.Read(after, "another", milliseconds(0));
    ASSERT_EQ(events.size(), 3u);
    EXPECT_TRUE(events[0].gap().other_life());
    EXPECT_EQ(events[0].life(), log.life());
    EXPECT_EQ(events[2].note(), "2");
  }
  EXPECT_EQ(log.Read(1, log.life(), milliseconds(0)).size(), 1u);
  EXPECT_NE(EventLog().life(), EventLog().life());
}

// Readers that wait see every event once and in order, and are let go by Close after the last.
TEST(EventLog, ManyReadersSeeEverythingOnce) {
  EventLog log;
  std::vector<std::thread> readers;
  std::array<uint64_t, 4> seen{};
  for (size_t r = 0; r < seen.size(); ++r) {
    readers.emplace_back([&, r] {
      uint64_t cursor = 0;
      for (;;) {
        const auto events = log.Read(cursor, "", std::chrono::seconds(20));
        if (events.empty()) return;
        for (const auto& event : events) {
          if (event.sequence() == cursor + 1) ++seen[r];
          cursor = event.sequence();
        }
      }
    });
  }
  AppendNotes(log, 1, 2000);
  log.Close();
  for (auto& reader : readers) reader.join();
  for (const uint64_t count : seen) EXPECT_EQ(count, 2000u);
}

}  // namespace
}  // namespace mesorig::daemon
