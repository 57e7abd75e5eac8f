#include "processing/report/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig::report {
namespace {

BenchRow Row(const char* series, const char* label, double error, double bytes, double rate) {
  BenchRow row;
  row.codec = row.series = series;
  row.label = label;
  row.options_json = "{}";
  row.rel_error = error;
  row.bytes = bytes;
  row.ratio = 1e6 / bytes;
  row.encode_s = bytes * 1e-5;
  row.image_samples_per_s = row.access_samples_per_s = rate;
  return row;
}

BenchReport Report() {
  BenchReport report;
  report.input = "a <b>`touch x`.btf.exr";
  report.rows = {Row("fmf", "4", 0.10, 100, 5e6), Row("fmf", "8", 0.04, 200, 3e6),
                 Row("view-svd", "4", 0.09, 900, 9e6), Row("pcmf", "8", 0.04, 300, 4e6)};
  return report;
}

TEST(BenchReport, TheFrontHoldsWhatNothingBeats) {
  const BenchReport report = Report();
  EXPECT_THAT(ParetoFront(report.rows, &BenchRow::bytes), ::testing::ElementsAre(0, 1));
}

TEST(BenchReport, RecommendsTheSmallestAndTheFastestUnderALimit) {
  BenchReport report = Report();
  report.error_limits = {0.2, 0.05, 0.001};
  const auto list = Recommend(report);
  ASSERT_EQ(list.size(), 3u);
  EXPECT_EQ(list[0].smallest, 0u);
  EXPECT_EQ(list[0].fastest, 2u);
  EXPECT_EQ(list[1].smallest, 1u);
  EXPECT_EQ(list[1].fastest, 3u);
  EXPECT_FALSE(list[2].smallest.has_value());
}

TEST(BenchReport, WritesAPageThatEscapesAndPlots) {
  btf::TemporaryFolder folder;
  const auto skipped = WriteBench(Report(), folder.path());
  ASSERT_TRUE(skipped.ok()) << skipped.status();
  const std::string html = *ReadFile(folder / "bench.html");
  EXPECT_EQ(html.find("<b>`touch"), std::string::npos);
  EXPECT_NE(html.find("Recommendation"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(*ReadFile(folder / "bench.json"))["rows"].size(), 4u);
  for (const std::string& line : *skipped) {
    EXPECT_THAT(line, ::testing::HasSubstr("not installed")) << line;
  }
  if (skipped->empty()) {
    EXPECT_GT(std::filesystem::file_size(folder / "plot_bytes.png"), 5000u);
  }
}

}  // namespace
}  // namespace mesorig::report
