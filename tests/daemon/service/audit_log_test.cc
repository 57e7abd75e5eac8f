// The audit log on a disk that fails, after kills and after tampering.

#include "daemon/service/audit_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "protocol/base/file_writer.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/protocol/base/scripted_disk.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

AuditEntry Entry(std::string call, std::string outcome = "OK") {
  AuditEntry entry;
  entry.caller = {Role::kOperator, "anna", "unix", ""};
  entry.call = std::move(call);
  entry.what = "plan_name: \"a\"";
  entry.outcome = std::move(outcome);
  return entry;
}

class AuditLogTest : public ::testing::Test {
 protected:
  std::unique_ptr<AuditLog> Open(uint64_t anchor_every = 100) {
    AuditOptions options;
    options.anchor_every = anchor_every;
    options.retry = std::chrono::milliseconds(1);
    options.rig_s = [] { return 12.5; };
    options.utc = [] {
      return std::chrono::system_clock::time_point(std::chrono::seconds(1800000000));
    };
    options.anchor = [this](std::string_view line) {
      const MutexLock lock(mutex_);
      anchors_.emplace_back(line);
    };
    options.faults = &disk_;
    auto log = AuditLog::Open(folder_.path(), options);
    EXPECT_TRUE(log.ok()) << log.status();
    return log.ok() ? *std::move(log) : nullptr;
  }
  std::filesystem::path path() const { return folder_.path() / kAuditFile; }
  std::string Text() const { return ReadFile(path()).value_or(""); }
  void Replace(const std::string& text) const {
    std::ofstream(path(), std::ios::binary | std::ios::trunc) << text;
  }
  std::vector<nlohmann::json> Entries() const {
    std::vector<nlohmann::json> entries;
    std::istringstream in(Text());
    for (std::string line; std::getline(in, line);) entries.push_back(nlohmann::json::parse(line));
    return entries;
  }
  std::vector<ChainHead> Anchors() {
    const MutexLock lock(mutex_);
    std::string all;
    for (const auto& line : anchors_) all += line + "\n";
    return FindAnchors(all);
  }
  ChainReport Verify(const std::vector<ChainHead>& anchors = {}) {
    auto report = VerifyChainFile(path(), anchors);
    EXPECT_TRUE(report.ok()) << report.status();
    return report.value_or(ChainReport());
  }

  TemporaryFolder folder_;
  ScriptedDisk disk_;
  Mutex mutex_;
  std::vector<std::string> anchors_ GUARDED_BY(mutex_);
};

TEST_F(AuditLogTest, SaysWhoDidWhat) {
  {
    auto log = Open();
    ASSERT_TRUE(log);
    EXPECT_TRUE(log->Record(Entry("Control/Run", "FAILED_PRECONDITION: \"busy\"\nby b\xff")).ok());
    EXPECT_EQ(log->head().sequence, 2u);
  }
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(entries[0]["call"], "daemon/opened");
  EXPECT_EQ(entries[2]["call"], "daemon/closed");
  const auto& run = entries[1];
  EXPECT_EQ(run["sequence"], 2);
  EXPECT_EQ(run["utc"], "2027-01-15T08:00:00.000Z");
  EXPECT_EQ(run["rig_s"], 12.5);
  EXPECT_EQ(run["name"], "anna");
  EXPECT_EQ(run["role"], "operator");
  EXPECT_EQ(run["peer"], "unix");
  EXPECT_EQ(run["call"], "Control/Run");
  EXPECT_THAT(run["outcome"].get<std::string>(), HasSubstr("\"busy\"\nby b"));
  EXPECT_TRUE(Verify(Anchors()).ok());
  EXPECT_EQ(Anchors().back().sequence, 3u);
}

TEST_F(AuditLogTest, GoesOnWhereItWas) {
  Open()->RecordLater(Entry("Control/Stop"));
  Open();
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 5u);
  EXPECT_EQ(entries[1]["call"], "Control/Stop");
  EXPECT_EQ(entries[3]["call"], "daemon/opened");
  EXPECT_EQ(entries[3]["what"], "3 entries");
  EXPECT_TRUE(Verify(Anchors()).ok());
}

TEST_F(AuditLogTest, AnchorsEverySoOften) {
  auto log = Open(10);
  for (int i = 0; i < 60; ++i) EXPECT_TRUE(log->Record(Entry("Control/Pause")).ok());
  log.reset();
  EXPECT_GE(Anchors().size(), 7u);
  EXPECT_TRUE(Verify(Anchors()).ok());
}

// A kill at any byte of the last entry: it goes on, and says so.
TEST_F(AuditLogTest, AKillLeavesABeginning) {
  Open();
  const std::string whole = Text();
  const size_t last = whole.rfind('\n', whole.size() - 2) + 1;
  for (size_t length = last; length < whole.size(); length += 7) {
    Replace(whole.substr(0, length));
    auto log = Open();
    ASSERT_TRUE(log);
    const auto entries = Entries();
    ASSERT_EQ(entries.size(), 2u);
    const std::string what = entries[1]["what"];
    EXPECT_EQ(what.find("dropped") != std::string::npos, length > last) << what;
    EXPECT_TRUE(log->health().ok());
    log.reset();
    EXPECT_TRUE(Verify().ok());
  }
}

TEST_F(AuditLogTest, ATamperedOneIsPutAside) {
  Open()->RecordLater(Entry("Control/Run"));
  std::string text = Text();
  text[text.find("anna")] = 'b';
  Replace(text);
  Open();
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_THAT(entries[0]["what"].get<std::string>(), HasSubstr("entry 2 is not what was hashed"));
  size_t damaged = 0;
  for (const auto& file : std::filesystem::directory_iterator(folder_.path())) {
    if (file.path().string().find(".damaged-") == std::string::npos) continue;
    ++damaged;
    EXPECT_EQ(ReadFile(file.path()).value_or(""), text);
  }
  EXPECT_EQ(damaged, 1u);
  EXPECT_FALSE(Verify(Anchors()).ok()) << "the anchors of the log before are missing";
}

TEST_F(AuditLogTest, AFullDiskIsToldAndNothingIsLost) {
  auto log = Open();
  disk_.FailFrom(0, ENOSPC);
  const Status refused = log->Record(Entry("Control/Run"));
  EXPECT_TRUE(absl::IsUnavailable(refused)) << refused;
  EXPECT_THAT(std::string(Message(refused)), HasSubstr("No space left"));
  EXPECT_FALSE(log->health().ok());
  log->RecordLater(Entry("Control/Stop"));  // returns whatever the disk does
  EXPECT_EQ(log->head().sequence, 1u);
  disk_.Heal();
  EXPECT_TRUE(log->Record(Entry("Control/Pause")).ok());
  EXPECT_TRUE(log->health().ok());
  log.reset();
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), 5u);
  EXPECT_EQ(entries[1]["call"], "Control/Run");
  EXPECT_EQ(entries[2]["call"], "Control/Stop");
  EXPECT_TRUE(Verify(Anchors()).ok());
}

TEST_F(AuditLogTest, ManyThreadsOneChain) {
  auto log = Open();
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 25; ++i) EXPECT_TRUE(log->Record(Entry("Control/Jog")).ok());
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(log->head().sequence, 101u);
  std::string read;
  for (;;) {
    const auto piece = log->Read(read.size(), 1000);
    ASSERT_TRUE(piece.ok());
    if (piece->empty()) break;
    read += *piece;
  }
  EXPECT_EQ(read, Text());
  log.reset();
  EXPECT_TRUE(Verify(Anchors()).ok());
}

TEST_F(AuditLogTest, LongTextIsCutAndNothingBreaksALine) {
  auto log = Open();
  AuditEntry entry = Entry("Control/Run");
  for (int i = 0; i < 256; ++i) entry.caller.name += static_cast<char>(i);
  entry.what = std::string(1 << 20, '"');
  entry.outcome = std::string(1 << 20, '\n');
  EXPECT_TRUE(log->Record(entry).ok());
  log.reset();
  EXPECT_EQ(Entries().size(), 3u);
  EXPECT_TRUE(Verify().ok());
}

}  // namespace
}  // namespace mesorig::daemon
