// A virtual day: nothing leaks, nothing drifts, every ledger balances, the audit log verifies. The
// week is a benchmark (tests/bench/soak.cc).

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/daemon/soak/soak.h"

#include <fmt/core.h>

namespace mesorig::daemon {
namespace {

TEST(Soak, AVirtualDay) {
  const auto root =
      std::filesystem::temp_directory_path() / fmt::format("mesorig-soak-{}", ::getpid());
  std::filesystem::remove_all(root);
  const SoakReport report = RunSoak(root, {});
  fmt::print("{}", report.Text());
  EXPECT_THAT(report.violations, ::testing::IsEmpty());
  EXPECT_GE(report.virtual_s, 86400);
  EXPECT_GT(report.complete, report.sessions / 2);
  EXPECT_GT(report.incomplete, 0u);
  EXPECT_GT(report.recoveries, 10u);
  EXPECT_GT(report.resumed, 0u);
  EXPECT_EQ(report.equal_sessions, report.complete);
  EXPECT_EQ(report.frames_read, report.frames_acknowledged);
  EXPECT_LT(report.worst_position_error_rad, 2e-3);
  ASSERT_FALSE(report.samples.empty());
  EXPECT_EQ(report.last().threads, report.settled().threads);
  EXPECT_EQ(report.last().open_files, report.settled().open_files);
  EXPECT_LT(report.last().resident_bytes, report.settled().resident_bytes + (16u << 20));
  std::filesystem::remove_all(root);
}

}  // namespace
}  // namespace mesorig::daemon
