// mesorig-render from outside: exit codes, one clear line, nothing half-written.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "processing/btf/btf_file.h"
#include "processing/btf/mdf_file.h"
#include "protocol/base/file_writer.h"
#include "renderer/gl/context.h"
#include "tests/renderer/gl/domes.h"
#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

using testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  std::string output;  // stdout and stderr
};

Outcome RunRender(const std::string& arguments, const std::string& environment = "") {
  Outcome outcome;
  FILE* pipe = popen(
      (environment + " " MESORIG_BIN_DIR "/mesorig-render " + arguments + " 2>&1").c_str(), "r");
  char buffer[4096];
  while (size_t n = fread(buffer, 1, sizeof buffer, pipe)) outcome.output.append(buffer, n);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  return outcome;
}

class RenderMainTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::path(testing::TempDir()) / fmt::format("render_main_test_{}", ::getpid());
    std::filesystem::create_directories(folder_);
    ASSERT_TRUE(WriteFileAtomically(Path("scene.toml"), R"(btf = "bumpy.btf.exr"
[image]
width_px = 120
height_px = 80
[camera]
eye_mm = [0, -200, 200]
[[light]]
direction = [1, 0, 1]
[[object]]
shape = "torus"
major_radius_mm = 50
minor_radius_mm = 20
)")
                    .ok());
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  bool OutputLeft() const {
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      if (entry.path().filename().string().find("out") != std::string::npos) return true;
    }
    return false;
  }
  void WriteBtf() const {
    ASSERT_TRUE(
        btf::WriteSampledBtf(MakeBumpyBtf(8, Rings(1, 0.5), Rings(1, 0.5)), Path("bumpy.btf.exr"))
            .ok());
  }
  // Files of the domes and a torus that wears them.
  void WriteDomes() const {
    ASSERT_TRUE(
        btf::WriteSampledBtf(DomesBtf(8, {{0, 0, 1}}, {{0, 0, 1}}), Path("d.btf.exr")).ok());
    ASSERT_TRUE(
        btf::WriteMdf(DomesMdf(32, Rings(RadFromDeg(75), RadFromDeg(15))), Path("d.mdf.exr")).ok());
    ASSERT_TRUE(WriteFileAtomically(Path("d.obj"), DomesObj(80)).ok());
    ASSERT_TRUE(WriteFileAtomically(Path("domes.toml"), R"(btf = "d.btf.exr"
[image]
width_px = 160
height_px = 120
msaa = 1
[camera]
eye_mm = [0, -250, 200]
[[light]]
direction = [1, 0, 1]
[[object]]
shape = "torus"
material = "btf+mdf"
major_radius_mm = 46
minor_radius_mm = 23
mm_per_unit = 40
)")
                    .ok());
  }
  std::filesystem::path folder_;
};

TEST_F(RenderMainTest, DrawsAndReports) {
  const auto context = GlContext::Create();
  if (!context.ok()) GTEST_SKIP() << context.status();
  WriteBtf();
  const Outcome outcome = RunRender(Path("scene.toml") + " --out " + Path("out.png") +
                                    " --frames 3 --check 200 --json");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  const auto figures = nlohmann::json::parse(outcome.output);
  EXPECT_GT(figures["ms_per_frame"].get<double>(), 0);
  EXPECT_EQ(figures["frames"], 3);
  EXPECT_EQ(figures["width_px"], 120);
  EXPECT_EQ(figures["codec"], "raw");
  EXPECT_FALSE(figures["renderer"].get<std::string>().empty());
  EXPECT_LT(figures["check"]["rel_error"].get<double>(), 2e-3);
  EXPECT_TRUE(std::filesystem::exists(Path("out.png")));
}

TEST_F(RenderMainTest, ComparesSilhouettesWithTheDisplacedSurface) {
  const auto context = GlContext::Create();
  if (!context.ok()) GTEST_SKIP() << context.status();
  WriteDomes();
  const std::string scene = Path("domes.toml") + " --out " + Path("out.png") + " --frames 1";
  const Outcome outcome =
      RunRender(scene + " --mdf " + Path("d.mdf.exr") + " --relief " + Path("d.obj") +
                " --compare " + Path("out_compare.png") + " --check 300 --json");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.output;
  const auto figures = nlohmann::json::parse(outcome.output);
  EXPECT_GT(figures["silhouette_iou"].get<double>(),
            figures["silhouette_iou_btf_only"].get<double>() + 0.2);
  EXPECT_GT(figures["band_pixels"].get<int>(), 300);
  EXPECT_GE(figures["silhouettes"]["passes"].get<int>(), 1);
  EXPECT_EQ(figures["silhouettes"]["exhausted"], false);
  EXPECT_NEAR(figures["relief_depth_mm"].get<double>(), kDomesReference - kDomesLowest, 0.05);
  EXPECT_LE(figures["silhouette_check"]["differing"].get<int>(), 2);
  EXPECT_GT(figures["ms_per_frame"].get<double>(), 0);
  EXPECT_TRUE(std::filesystem::exists(Path("out.png")));
  EXPECT_TRUE(std::filesystem::exists(Path("out_compare.png")));
}

TEST_F(RenderMainTest, BadSilhouetteInputIsExit2) {
  const auto context = GlContext::Create();
  if (!context.ok()) GTEST_SKIP() << context.status();
  WriteDomes();
  btf::SampledBtf other = DomesBtf(8, {{0, 0, 1}}, {{0, 0, 1}});
  other.mutable_header().h_ref_mm = 3;
  ASSERT_TRUE(btf::WriteSampledBtf(other, Path("other.btf.exr")).ok());
  ASSERT_TRUE(WriteFileAtomically(Path("bad.obj"), "v 1 2 x\n").ok());
  ASSERT_TRUE(WriteFileAtomically(Path("bad.mdf.exr"), "nothing").ok());
  const std::string out = " --out " + Path("out.png"), mdf = " --mdf " + Path("d.mdf.exr");
  const struct {
    std::string arguments, what;
  } cases[] = {
      {Path("domes.toml") + out, "--mdf is not given"},
      {Path("domes.toml") + out + " --mdf " + Path("none.mdf.exr"), "none.mdf.exr"},
      {Path("domes.toml") + out + " --mdf " + Path("bad.mdf.exr"), "bad.mdf.exr"},
      {Path("domes.toml") + out + mdf + " --relief " + Path("bad.obj"), "bad.obj:1"},
      {Path("domes.toml") + out + mdf + " --relief " + Path("none.obj"), "none.obj"},
      {Path("domes.toml") + out + mdf + " --compare " + Path("out2.png"), "--relief"},
      {Path("scene.toml") + out + mdf + " --btf " + Path("d.btf.exr") + " --relief " +
           Path("d.obj"),
       "btf+mdf"},
      {Path("domes.toml") + out + mdf + " --btf " + Path("other.btf.exr"), "reference plane"},
  };
  for (const auto& c : cases) {
    const Outcome outcome = RunRender(c.arguments + " --frames 1");
    EXPECT_EQ(outcome.exit_code, 2) << c.arguments << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(c.what)) << c.arguments;
    EXPECT_FALSE(OutputLeft());
  }
}

TEST_F(RenderMainTest, BadInputIsExit2OneLineAndNoPicture) {
  ASSERT_TRUE(WriteFileAtomically(Path("garbage.btf.exr"), "not an EXR at all").ok());
  ASSERT_TRUE(
      WriteFileAtomically(Path("bad.toml"), *ReadFile(Path("scene.toml")) + "lamp = 3\n").ok());
  const std::string out = " --out " + Path("out.png");
  const struct {
    std::string arguments, what;
  } cases[] = {
      {Path("scene.toml") + out, "bumpy.btf.exr"},  // the file is not there
      {Path("scene.toml") + out + " --btf " + Path("garbage.btf.exr"), "garbage.btf.exr"},
      {Path("missing.toml") + out, "missing.toml"},
      {Path("bad.toml") + out, "bad.toml:13:1"},
      {Path("scene.toml") + out + " --size 3x9", "8 to 8192"},
      {Path("scene.toml"), "--out"},
      {"", "scene"},
  };
  for (const auto& c : cases) {
    const Outcome outcome = RunRender(c.arguments);
    EXPECT_EQ(outcome.exit_code, 2) << c.arguments << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(c.what)) << c.arguments;
    EXPECT_FALSE(OutputLeft());
  }
}

TEST_F(RenderMainTest, WithoutADriverItSaysSo) {
  WriteBtf();
  const Outcome outcome = RunRender(Path("scene.toml") + " --out " + Path("out.png"),
                                    "__EGL_VENDOR_LIBRARY_FILENAMES=/dev/null");
  EXPECT_EQ(outcome.exit_code, 1) << outcome.output;
  EXPECT_THAT(outcome.output, HasSubstr("OpenGL"));
  EXPECT_FALSE(OutputLeft());
}

TEST_F(RenderMainTest, HelpNamesWhatANewcomerNeeds) {
  const Outcome outcome = RunRender("--help");
  EXPECT_EQ(outcome.exit_code, 0);
  for (const char* word :
       {"scene", "--out", "--btf", "--mdf", "--relief", "--compare", "--frames", "--json"}) {
    EXPECT_THAT(outcome.output, HasSubstr(word));
  }
}

}  // namespace
}  // namespace mesorig::renderer
