#include "processing/report/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <random>

#include "processing/report/gnuplot.h"
#include "protocol/base/file_writer.h"

namespace mesorig::report {
namespace {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

json Example() {
  json report = json::parse(R"({
    "title": "First light", "sample": "weave <with> a letter",
    "capture": {"frames_planned": 2304, "frames_on_disk": 2304, "virtual_s": 1810.4, "wall_s": 61.2},
    "btf": {"psnr_db": 33.1, "rel_error": 0.083, "wall_s": 12.5,
      "by_view_theta": [{"theta_deg": 0, "psnr_db": 36.0}, {"theta_deg": 40, "psnr_db": 34.5},
                        {"theta_deg": 75, "psnr_db": 28.7}],
      "by_light_theta": [{"theta_deg": 8, "psnr_db": 32.0}, {"theta_deg": 75, "psnr_db": 38.7}]},
    "mdf": {"median_abs_mm": 0.0123, "rmse_mm": 0.234, "coverage": 0.9876,
      "best_plane_median_abs_mm": 0.789, "wall_s": 4.5,
      "by_view_theta": [{"theta_deg": 40, "median_abs_mm": 0.0456, "rmse_mm": 0.3, "coverage": 1}]},
    "codec": {"view_svd": {"terms": 4, "bytes": 9400000, "ratio": 12.5, "psnr_db": 38.2,
                           "rel_error": 0.04, "encode_s": 2.1},
      "sweep": [{"terms": 1, "bytes": 2400000, "ratio": 49, "psnr_db": 30.2, "rel_error": 0.1, "encode_s": 1.2},
                {"terms": 4, "bytes": 9400000, "ratio": 12.5, "psnr_db": 38.2, "rel_error": 0.04, "encode_s": 2.1}]},
    "render": {"ms_per_frame": 84.2},
    "real": {"cat": {"psnr_db": 34.2, "lambert_psnr_db": 28.9, "wall_s": 3.2}},
    "stages": [{"name": "capture", "wall_s": 61.2, "figure": "2304 of 2304 frames"},
               {"name": "assemble", "wall_s": 12.5, "figure": "33.1 dB"}],
    "pictures": [{"file": "torus.png", "caption": "A torus & its slab"}]})");
  return report;
}

class ReportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    dir_ = std::filesystem::path(::testing::TempDir()) /
           fmt::format("report_{}_{}", ::getpid(),
                       ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(dir_);
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }
  StatusOr<ReportResult> Write(const std::string& text) {
    EXPECT_TRUE(WriteFileAtomically(dir_ / "report.json", text).ok());
    return WriteReport(dir_ / "report.json", dir_ / "report.html");
  }
  std::string Html() const { return ReadFile(dir_ / "report.html").value(); }
  std::filesystem::path dir_;
};

bool HaveGnuplot() { return std::system("gnuplot --version >/dev/null 2>&1") == 0; }

TEST_F(ReportTest, ShowsWhatIsThere) {
  if (!HaveGnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  ASSERT_TRUE(WriteFileAtomically(dir_ / "torus.png", "png").ok());
  const auto result = Write(Example().dump());
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_THAT(result->skipped, IsEmpty());
  EXPECT_EQ(result->plots.size(), 3u);
  for (const std::string& plot : result->plots) {
    const auto png = ReadFile(dir_ / plot);
    ASSERT_TRUE(png.ok());
    EXPECT_EQ(png->substr(1, 3), "PNG");
    EXPECT_GT(png->size(), 5000u);
  }
  const std::string html = Html();
  EXPECT_THAT(html, HasSubstr("<h1>First light</h1>"));
  EXPECT_THAT(html, HasSubstr("weave &lt;with&gt; a letter"));
  EXPECT_THAT(html, HasSubstr("src=\"torus.png\""));
  EXPECT_THAT(html, HasSubstr("A torus &amp; its slab"));
  EXPECT_THAT(html, HasSubstr("<td class=\"number\">33.10</td>"));
  EXPECT_THAT(html, HasSubstr("0.012</td>"));  // the MDF's median
  EXPECT_THAT(html, HasSubstr("98.8 %"));
  EXPECT_THAT(html, Not(HasSubstr("http")));
}

TEST_F(ReportTest, SaysWhatIsMissing) {
  const auto result = Write("{}");
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_THAT(result->skipped, Contains("capture: report.json has no capture"));
  EXPECT_THAT(result->skipped, Contains("pictures: report.json has no pictures"));
  EXPECT_THAT(Html(), HasSubstr("Not in this report"));
}

TEST_F(ReportTest, PicturesFromElsewhereAreNotShown) {
  json report = {{"pictures", json::array()}};
  for (const char* file : {"/etc/passwd", "../x.png", "javascript:alert(1)", "https://x/y.png", "", "gone.png"}) {
    report["pictures"].push_back({{"file", file}, {"caption", "<script>"}});
  }
  ASSERT_TRUE(Write(report.dump()).ok());
  EXPECT_THAT(Html(), Not(HasSubstr("<img")));
  EXPECT_THAT(Html(), Not(HasSubstr("<script>")));
}

// gnuplot executes what stands between backticks, and @macros, in its scripts.
TEST_F(ReportTest, NamesAreNeverExecuted) {
  if (!HaveGnuplot()) GTEST_SKIP() << "gnuplot is not installed";
  const std::string mark = (dir_ / "executed").string();
  json report = Example();
  report["stages"][0]["name"] = "`touch " + mark + "`\" ; system(\"touch " + mark + "\")";
  report["stages"][1]["name"] = "@x $(touch " + mark + ") \\";
  report["codec"]["sweep"][0]["codec"] = "`touch " + mark + "`";
  ASSERT_TRUE(Write(report.dump()).ok());
  EXPECT_FALSE(std::filesystem::exists(mark));
  EXPECT_TRUE(std::filesystem::exists(dir_ / "plot_stages.png"));
}

TEST_F(ReportTest, RefusesWhatIsNoReport) {
  EXPECT_TRUE(absl::IsInvalidArgument(Write("[1, 2]").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(Write("{\"a\": ").status()));
  EXPECT_TRUE(absl::IsNotFound(WriteReport(dir_ / "gone.json", dir_ / "report.html").status()));
  EXPECT_FALSE(std::filesystem::exists(dir_ / "report.html"));
  ASSERT_TRUE(Write("{}").ok());
  EXPECT_TRUE(absl::IsInvalidArgument(
      WriteReport(dir_ / "report.json", dir_.parent_path() / "r.html").status()));
}

// Every value in turn replaced by one of another type, and texts cut and spoilt.
TEST_F(ReportTest, SurvivesMalformedReports) {
  json report = Example();
  report["codec"].erase("sweep"), report["btf"].erase("by_view_theta"), report.erase("stages");  // no gnuplot
  const json odd[] = {nullptr, true, "text", -1, 1e308, json::array(), json::object(), json::array({1, nullptr})};
  const json flat = report.flatten();
  for (const auto& [pointer, value] : flat.items()) {
    for (const json& other : odd) {
      json changed = report;
      changed[json::json_pointer(pointer)] = other;
      EXPECT_TRUE(Write(changed.dump()).ok()) << pointer;
    }
  }
  for (const char* key : {"title", "capture", "btf", "mdf", "codec", "render", "real", "stages", "pictures"}) {
    for (const json& other : odd) {
      json changed = report;
      changed[key] = other;
      EXPECT_TRUE(Write(changed.dump()).ok()) << key;
    }
  }
  std::mt19937 random(11);
  const std::string text = report.dump();
  for (int round = 0; round < 2000; ++round) {
    std::string spoilt = text.substr(0, random() % 4 == 0 ? random() % text.size() : text.size());
    for (size_t k = 0; k < 1 + random() % 4 && !spoilt.empty(); ++k) {
      spoilt[random() % spoilt.size()] = static_cast<char>(random() & 0xff);
    }
    (void)Write(spoilt);
  }
}

}  // namespace
}  // namespace mesorig::report
