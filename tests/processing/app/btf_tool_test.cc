// The program itself: exit codes, one line an error, figures as JSON.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "processing/btf/btf_file.h"
#include "processing/btf/mdf_file.h"
#include "protocol/base/file_writer.h"
#include "tests/processing/btf/synthetic.h"

namespace mesorig {
namespace {

using btf::RingDirections;
using ::testing::HasSubstr;

struct Output {
  int exit = -1;
  std::string text;  // standard output and error
};

Output Tool(const std::string& arguments) {
  Output output;
  const std::string command = std::string(MESORIG_BIN_DIR) + "/mesorig-btf " + arguments + " 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  char buffer[4096];
  for (size_t n; (n = std::fread(buffer, 1, sizeof(buffer), pipe)) > 0;) {
    output.text.append(buffer, n);
  }
  output.exit = WEXITSTATUS(::pclose(pipe));
  return output;
}

class BtfTool : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto header =
        btf::SmallHeader(16, 12, RingDirections(2, 6, 60), RingDirections(2, 6, 60));
    ASSERT_TRUE(btf::WriteSampledBtf(btf::SyntheticBtf(header), folder_ / "a.btf.exr").ok());
  }
  std::string Path(std::string_view name) { return (folder_ / name).string(); }
  btf::TemporaryFolder folder_;
};

TEST_F(BtfTool, Info) {
  const Output text = Tool("info " + Path("a.btf.exr"));
  EXPECT_EQ(text.exit, 0);
  EXPECT_THAT(text.text, HasSubstr("13 views x 13 lights, 169 of 169 pairs present"));
  const auto json = nlohmann::json::parse(Tool("info --json " + Path("a.btf.exr")).text);
  EXPECT_EQ(json["codec"], "raw");
  EXPECT_EQ(json["uncompressed_bytes"], 169 * 16 * 12 * 6);
}

TEST_F(BtfTool, InfoOfAnMdf) {
  btf::MdfHeader header;
  header.width = 16, header.height = 12, header.pitch_mm = 0.5, header.h_ref_mm = 3;
  header.views = RingDirections(2, 6, 60);
  ASSERT_TRUE(btf::WriteMdf(btf::Mdf(header), folder_ / "a.mdf.exr").ok());
  const Output text = Tool("info " + Path("a.mdf.exr"));
  EXPECT_EQ(text.exit, 0);
  EXPECT_THAT(text.text, HasSubstr("reference plane at 3 mm, 13 views"));
  const auto json = nlohmann::json::parse(Tool("info --json " + Path("a.mdf.exr")).text);
  EXPECT_EQ(json["kind"], "mdf");
  EXPECT_EQ(json["views"].size(), 13u);
}

TEST_F(BtfTool, CompressToATarget) {
  const Output error = Tool("compress --json --codec fmf --target-error 0.05 " + Path("a.btf.exr") +
                            " --out " + Path("b.btf.exr"));
  ASSERT_EQ(error.exit, 0) << error.text;
  const auto a = nlohmann::json::parse(error.text);
  EXPECT_LE(a["rel_error"], 0.05);
  EXPECT_TRUE(a.contains("clamped_mass"));
  const Output bytes = Tool("compress --json --codec fmf --quantise 8bit --target-bytes 20000 " +
                            Path("a.btf.exr") + " --out " + Path("b.btf.exr"));
  ASSERT_EQ(bytes.exit, 0) << bytes.text;
  EXPECT_LE(nlohmann::json::parse(bytes.text)["bytes"], 20000);
  const Output both = Tool("compress --codec fmf --target-bytes 20000 --target-error 0.1 " +
                           Path("a.btf.exr") + " --out " + Path("b.btf.exr"));
  EXPECT_EQ(both.exit, 2) << both.text;
  const Output none = Tool("compress --codec mean --target-error 0.1 " + Path("a.btf.exr") +
                           " --out " + Path("b.btf.exr"));
  EXPECT_EQ(none.exit, 2) << none.text;
}

TEST_F(BtfTool, NegativeValuesAreKeptOrClampedAndTheirMassIsSaid) {
  btf::SampledBtf dark = *btf::ReadSampledBtf(folder_ / "a.btf.exr");
  for (int pair = 0; pair < 169; ++pair) {  // most of it is black: few terms overshoot there
    for (float& x : dark.MutableImage(pair / 13, pair % 13)) x = std::max(x - 0.2f, 0.0f);
  }
  ASSERT_TRUE(btf::WriteSampledBtf(dark, folder_ / "dark").ok());
  const std::string command = "compress --json --codec fmf --terms 2 " + Path("dark");
  const auto kept = nlohmann::json::parse(Tool(command + " --out " + Path("k")).text);
  const auto clamped =
      nlohmann::json::parse(Tool(command + " --negative clamp --out " + Path("c")).text);
  EXPECT_EQ(kept["negative_values"], "keep");
  EXPECT_EQ(clamped["negative_values"], "clamp");
  EXPECT_GT(kept["clamped_mass"], 0);
  EXPECT_EQ(kept["clamped_mass"], clamped["clamped_mass"]);
  EXPECT_LT(clamped["rel_error"], kept["rel_error"]);
  EXPECT_EQ(nlohmann::json::parse(Tool("info --json " + Path("c")).text)["negative_values"], "clamp");
  EXPECT_EQ(Tool(command + " --negative maybe --out " + Path("c")).exit, 2);
}

TEST_F(BtfTool, Bench) {
  const Output output = Tool("bench --json --codecs mean,fmf,pcmf --most-terms 4 --out " +
                             Path("bench") + " " + Path("a.btf.exr"));
  ASSERT_EQ(output.exit, 0) << output.text;
  const auto json = nlohmann::json::parse(output.text);
  ASSERT_EQ(json["rows"].size(), 1u + 6 + 6);
  for (const auto& row : json["rows"]) {
    for (const char* key : {"rel_error", "psnr_db", "p99_abs", "bytes", "ratio", "encode_s",
                            "image_samples_per_s", "access_samples_per_s"}) {
      EXPECT_GT(row[key], 0) << key << row;
    }
    EXPECT_FALSE(row["by_view_theta"].empty());
    EXPECT_TRUE(std::filesystem::exists(folder_ / "bench" / row["picture"].get<std::string>()));
  }
  EXPECT_FALSE(json["pareto_bytes"].empty());
  EXPECT_FALSE(json["recommendation"].empty());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "bench" / "bench.html"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "bench" / "bench.json"));
  EXPECT_EQ(Tool("bench --codecs nonsense " + Path("a.btf.exr")).exit, 2);
}

TEST_F(BtfTool, CompressThenCompareSaysTheSame) {
  const Output compress = Tool("compress --json --codec view-svd --terms 8 " + Path("a.btf.exr") +
                              " --out " + Path("b.btf.exr"));
  ASSERT_EQ(compress.exit, 0) << compress.text;
  const auto a = nlohmann::json::parse(compress.text);
  EXPECT_EQ(a["terms"], 8);
  EXPECT_EQ(a["bytes"], std::filesystem::file_size(folder_ / "b.btf.exr"));
  EXPECT_GT(a["psnr_db"], 25);
  EXPECT_TRUE(a.contains("seconds") && a.contains("ratio"));
  const auto b = nlohmann::json::parse(
      Tool("compare --json " + Path("b.btf.exr") + " " + Path("a.btf.exr")).text);
  EXPECT_EQ(a["rel_error"], b["rel_error"]);
  EXPECT_EQ(a["psnr_db"], b["psnr_db"]);
}

TEST_F(BtfTool, AllTermsReproduce) {
  const auto json = nlohmann::json::parse(Tool("compress --json --codec view-svd --terms all " +
                                              Path("a.btf.exr") + " -o " + Path("b")).text);
  EXPECT_LT(json["rel_error"], 1e-6);
}

TEST_F(BtfTool, Slice) {
  EXPECT_EQ(Tool("slice " + Path("a.btf.exr") + " --view 1 --light 2 -o " + Path("s.png")).exit, 0);
  EXPECT_EQ(ReadFile(folder_ / "s.png")->substr(1, 3), "PNG");
  EXPECT_EQ(Tool("slice " + Path("a.btf.exr") + " --view 99 --light 2 -o " + Path("t.png")).exit, 2);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "t.png"));
}

TEST_F(BtfTool, CrossValidate) {
  const Output ptm = Tool("cross-validate --json --codec rf-ptm " + Path("a.btf.exr") +
                         " --pictures " + Path("pictures"));
  ASSERT_EQ(ptm.exit, 0) << ptm.text;
  const auto json = nlohmann::json::parse(ptm.text);
  EXPECT_EQ(json["lights"].size(), 13u);
  EXPECT_TRUE(json.contains("psnr_db") && json.contains("lambert_psnr_db"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "pictures/view_000_light_000.png"));
  const Output svd = Tool("cross-validate --codec view-svd " + Path("a.btf.exr"));
  EXPECT_EQ(svd.exit, 1);
  EXPECT_THAT(svd.text, HasSubstr("UNIMPLEMENTED"));
}

TEST_F(BtfTool, BadInputIsOneLineAndExitTwo) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / "garbage", std::string(5000, 'x')).ok());
  std::filesystem::create_directory(folder_ / "empty");
  const std::string out = " -o " + Path("never.exr");
  for (const std::string& arguments :
       {"info " + Path("garbage"), "info " + Path("absent"), "info " + folder_.path().string(),
        "compress --codec view-svd " + Path("garbage") + out,
        "compress --codec view-svd --terms 14 " + Path("a.btf.exr") + out,
        "compress --codec nonsense " + Path("a.btf.exr") + out,
        "compare " + Path("a.btf.exr") + " " + Path("garbage"),
        "import --format nonsense " + Path("empty") + out, "import " + Path("empty") + out,
        "compress --codec view-svd " + Path("a.btf.exr") + " -o " + Path("no/such/folder.exr")}) {
    const Output output = Tool(arguments);
    EXPECT_EQ(output.exit, 2) << arguments << "\n" << output.text;
    EXPECT_EQ(std::count(output.text.begin(), output.text.end(), '\n'), 1) << output.text;
    EXPECT_TRUE(output.text.starts_with("mesorig-btf: ")) << output.text;
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "never.exr"));
  EXPECT_EQ(Tool("").exit, 2);
  EXPECT_EQ(Tool("compress --codec view-svd --terms zero " + Path("a.btf.exr") + out).exit, 2);
  EXPECT_EQ(Tool("--help").exit, 0);
  EXPECT_EQ(Tool("--version").exit, 0);
}

TEST_F(BtfTool, CompareOfMdfs) {
  btf::MdfHeader header;
  header.width = 16, header.height = 12, header.pitch_mm = 0.5, header.h_ref_mm = 3;
  header.views = RingDirections(2, 6, 60);
  btf::Mdf mdf(header);
  for (int v = 0; v < header.view_count(); ++v) {
    std::ranges::fill(mdf.MutableConfidence(v), 1.0f);
    std::ranges::fill(mdf.MutableDistance(v), 2.0f);
  }
  ASSERT_TRUE(btf::WriteMdf(mdf, folder_ / "truth.mdf.exr").ok());
  for (float& d : mdf.MutableDistance(0)) d += 0.25f;
  ASSERT_TRUE(btf::WriteMdf(mdf, folder_ / "m.mdf.exr").ok());
  const Output text = Tool("compare --json --by-angle " + Path("m.mdf.exr") + " " +
                           Path("truth.mdf.exr"));
  ASSERT_EQ(text.exit, 0) << text.text;
  const auto json = nlohmann::json::parse(text.text);
  EXPECT_EQ(json["median_abs_mm"], 0);
  EXPECT_EQ(json["coverage"], 1);
  EXPECT_NEAR(json["rmse_mm"], 0.25 / std::sqrt(13.0), 1e-6);
  EXPECT_EQ(json["by_view_theta"][0]["median_abs_mm"], 0.25);
  const Output slice = Tool("slice " + Path("m.mdf.exr") + " --view 3 -o " + Path("m.png"));
  EXPECT_EQ(slice.exit, 0) << slice.text;
  EXPECT_THAT(*ReadFile(folder_ / "m.png"), HasSubstr("PNG"));
  EXPECT_EQ(Tool("slice " + Path("m.mdf.exr") + " --view 13 -o " + Path("n.png")).exit, 2);
  EXPECT_EQ(Tool("slice " + Path("m.mdf.exr") + " --view 1 --light 0 -o " + Path("n.png")).exit, 2);
  EXPECT_EQ(Tool("slice " + Path("a.btf.exr") + " --view 1 -o " + Path("n.png")).exit, 2);
  EXPECT_EQ(Tool("compare " + Path("m.mdf.exr") + " " + Path("a.btf.exr")).exit, 2);
  EXPECT_EQ(Tool("compare " + Path("a.btf.exr") + " " + Path("m.mdf.exr")).exit, 2);
}

// A vertical stripe at u = 40.5 + shift with a slope of 0.1, 80 x 60 pixels, as a TGA file.
void WriteStripe(const std::filesystem::path& path, double shift) {
  std::string bytes(18, '\0');
  bytes[2] = 2, bytes[12] = 80, bytes[14] = 60, bytes[16] = 24, bytes[17] = 0x20;
  for (int j = 0; j < 60; ++j) {
    for (int i = 0; i < 80; ++i) {
      const double apart = i + 0.5 - (40.5 + shift + 0.1 * (j + 0.5 - 30));
      const double green = 10 + 200 * std::exp(-0.5 * apart * apart / 6);
      bytes += {3, static_cast<char>(static_cast<int>(green + 0.5)), 3};
    }
  }
  ASSERT_TRUE(WriteFileAtomically(path, bytes).ok());
}

TEST_F(BtfTool, Stripe) {
  WriteStripe(folder_ / "a.tga", 0);
  WriteStripe(folder_ / "b.tga", 0.2);
  const std::string both = Path("a.tga") + " " + Path("b.tga");
  const Output text = Tool("stripe --json --region 10,0,60,60 " + both);
  ASSERT_EQ(text.exit, 0) << text.text;
  const auto json = nlohmann::json::parse(text.text);
  EXPECT_EQ(json["profiles"], "rows");
  EXPECT_NEAR(json["fits"][0]["position_px"], 40.5, 0.01);
  EXPECT_NEAR(json["fits"][1]["position_px"], 40.7, 0.01);
  EXPECT_NEAR(json["position_std_px"], 0.2 / std::sqrt(2.0), 0.01);
  EXPECT_NEAR(json["angle_deg"], 90 + DegFromRad(std::atan(0.1)), 0.05);
  EXPECT_EQ(Tool("stripe --region 10,0,71,60 " + both).exit, 2);
  EXPECT_EQ(Tool("stripe --region 10,0 " + both).exit, 2);
  EXPECT_EQ(Tool("stripe --region -1,0,60,60 " + both).exit, 2);
  EXPECT_EQ(Tool("stripe " + Path("a.btf.exr")).exit, 2);
  EXPECT_EQ(Tool("stripe " + Path("absent.png")).exit, 2);
  const Output none = Tool("stripe --region 0,0,20,60 " + both);
  EXPECT_EQ(none.exit, 1);
  EXPECT_THAT(none.text, HasSubstr("none of 2 images shows a stripe"));
}

TEST_F(BtfTool, StripeOfPhotographs) {
  const auto folder = std::filesystem::path(MESORIG_SOURCE_DIR).parent_path() / "shared" / "data" /
                      "laser_line";
  if (!std::filesystem::is_directory(folder)) GTEST_SKIP() << folder << " is absent";
  const Output text = Tool("stripe --json --region 0,5,640,165 " + folder.string() + "/*.jpg");
  ASSERT_EQ(text.exit, 0) << text.text;
  const auto json = nlohmann::json::parse(text.text);
  EXPECT_EQ(json["fitted"], 40);
  EXPECT_LT(json["position_std_px"], 0.06);  // a fit of plain centroids: 0.15
  EXPECT_LT(json["position_mad_px"], 0.05);  // 0.08
}

}  // namespace
}  // namespace mesorig
