#include "processing/report/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
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
  row.rmse = 0.3 * error;
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

TEST(BenchReport, TellsWhatFmfHasAtEqualBytes) {
  const BenchReport report = Report();
  EXPECT_FALSE(FmfErrorAt(report.rows, 99).has_value());
  EXPECT_NEAR(FmfErrorAt(report.rows, 100)->rel_error, 0.10, 1e-12);
  EXPECT_NEAR(FmfErrorAt(report.rows, 100 * std::sqrt(2.0))->rel_error, std::sqrt(0.10 * 0.04), 1e-12);
  EXPECT_FALSE(FmfErrorAt(report.rows, 200)->beyond);
  const FmfError beyond = *FmfErrorAt(report.rows, 900);
  EXPECT_TRUE(beyond.beyond);
  EXPECT_NEAR(beyond.rel_error, 0.04, 1e-12);
  EXPECT_EQ(beyond.Beats(0.05), true);
  EXPECT_FALSE(beyond.Beats(0.03).has_value());  // more terms of fmf might
  const auto json = nlohmann::json::parse(BenchJson(report));
  EXPECT_EQ(json["rows"][2]["loses_to_fmf"], true);     // view-svd: 0.09 in 900 bytes
  EXPECT_FALSE(json["rows"][0].contains("loses_to_fmf"));
  EXPECT_FALSE(FmfErrorAt({report.rows[2]}, 900).has_value());
}

TEST(BenchReport, HasEveryFrontAndThePublishedSizes) {
  const auto json = nlohmann::json::parse(BenchJson(Report()));
  EXPECT_EQ(json["pareto_bytes"], (std::vector<size_t>{0, 1}));
  EXPECT_EQ(json["pareto_encode"], (std::vector<size_t>{0, 1}));
  EXPECT_EQ(json["pareto_access"], (std::vector<size_t>{2, 3}));  // 9 and 4 M samples/s
  EXPECT_EQ(json["pareto_images"], (std::vector<size_t>{2, 3}));
  // The survey's PCMF follows from our planes: 11 MB.
  for (const auto& row : json["published"]) {
    if (row["method"] == "PCMF, 32 clusters of 8 terms") {
      EXPECT_NEAR(row["ours_bytes"].get<double>() / row["published_bytes"].get<double>(), 1, 0.1);
    }
  }
  EXPECT_EQ(json["published"].size(), 6u + 3);
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
  BenchReport report = Report();
  report.materials = {Row("wool", "1", 0.2, 1, 1), Row("wool", "2", 0.1, 1, 1),
                      Row("stone", "1", 0.4, 1, 1)};
  const auto skipped = WriteBench(report, folder.path());
  ASSERT_TRUE(skipped.ok()) << skipped.status();
  const std::string html = *ReadFile(folder / "bench.html");
  EXPECT_EQ(html.find("<b>`touch"), std::string::npos);
  for (const char* what : {"Recommendation", "0.0400", "2.25 x, loses", "view-svd at 1 of 1 settings",
                           "PCMF, 32 clusters", "peanut, weave", "stays within 0.03, 0.02"}) {
    EXPECT_NE(html.find(what), std::string::npos) << what;
  }
  EXPECT_EQ(nlohmann::json::parse(*ReadFile(folder / "bench.json"))["rows"].size(), 4u);
  for (const std::string& line : *skipped) {
    EXPECT_THAT(line, ::testing::HasSubstr("not installed")) << line;
  }
  if (skipped->empty()) {
    EXPECT_GT(std::filesystem::file_size(folder / "plot_bytes.png"), 5000u);
    EXPECT_GT(std::filesystem::file_size(folder / "plot_materials.png"), 5000u);
  }
}

}  // namespace
}  // namespace mesorig::report
