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
  EXPECT_TRUE(log.Read(0, milliseconds(0)).empty());
  AppendNotes(log, 1, 10);
  const auto all = log.Read(0, milliseconds(0));
  ASSERT_EQ(all.size(), 10u);
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(all[i].sequence(), i + 1u);
    EXPECT_EQ(all[i].note(), std::to_string(i + 1));
  }
  const auto rest = log.Read(7, milliseconds(0));
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(rest.front().sequence(), 8u);
  EXPECT_TRUE(log.Read(10, milliseconds(0)).empty());
}

TEST(EventLog, TellsWhatIsNoLongerKept) {
  EventLog log(4);
  AppendNotes(log, 1, 10);
  const auto events = log.Read(2, milliseconds(0));
  ASSERT_EQ(events.size(), 5u);
  EXPECT_EQ(events[0].note(), "4 earlier events are no longer kept");
  EXPECT_EQ(events[0].sequence(), 6u);
  EXPECT_EQ(events[1].note(), "7");
  EXPECT_EQ(log.Read(6, milliseconds(0)).front().note(), "7");
}

TEST(EventLog, TellsACursorOfAnEarlierLife) {
  EventLog log;
  auto events = log.Read(500, milliseconds(0));
  ASSERT_EQ(events.size(), 1u);
  EXPECT_EQ(events[0].sequence(), 0u) << "the reader begins anew";
  AppendNotes(log, 1, 2);
  events = log.Read(500, milliseconds(0));
  ASSERT_EQ(events.size(), 3u);
  EXPECT_EQ(events[2].note(), "2");
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
        const auto events = log.Read(cursor, std::chrono::seconds(20));
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
