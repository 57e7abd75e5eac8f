// mesorig-render: draws a scene file to a PNG.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>

#include "protocol/base/program.h"
#include "renderer/gl/cpu_check.h"
#include "renderer/gl/scene_renderer.h"

namespace mesorig::renderer {
namespace {

struct Options {
  std::filesystem::path scene, out, btf;
  std::string size;
  int frames = 10;
  size_t check = 0;
  bool json = false;
};

// Fewer frames are drawn when they are slow: the picture matters more than the last digit.
constexpr double kTimingBudgetMs = 20000;

double Milliseconds(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

struct Timing {
  int frames = 0;
  double first_ms = 0;      // compiles and uploads what the driver put off
  double ms_per_frame = 0;  // median of the frames after the first
};

Timing DrawFrames(SceneRenderer& renderer, int frames) {
  Timing timing;
  const auto start = std::chrono::steady_clock::now();
  renderer.Draw();
  timing.first_ms = Milliseconds(start);
  std::vector<double> times;
  while (static_cast<int>(times.size()) < frames &&
         (times.empty() || Milliseconds(start) < kTimingBudgetMs)) {
    const auto frame_start = std::chrono::steady_clock::now();
    renderer.Draw();
    times.push_back(Milliseconds(frame_start));
  }
  timing.frames = static_cast<int>(times.size());
  std::sort(times.begin(), times.end());
  const size_t middle = times.size() / 2;
  timing.ms_per_frame =
      times.size() % 2 == 1 ? times[middle] : (times[middle - 1] + times[middle]) / 2;
  return timing;
}

Status ApplySize(const std::string& size, ImageSettings& image) {
  if (size.empty()) return OkStatus();
  int width = 0, height = 0;
  char rest = 0;
  if (std::sscanf(size.c_str(), "%5dx%5d%c", &width, &height, &rest) != 2 || width < 8 ||
      width > 8192 || height < 8 || height > 8192) {
    return InvalidArgument("--size {}: permitted is WIDTHxHEIGHT, 8 to 8192 pixels each", size);
  }
  image.width = width;
  image.height = height;
  return OkStatus();
}

StatusOr<Scene> LoadSceneFor(const Options& options) {
  MESORIG_ASSIGN_OR_RETURN(Scene scene, LoadScene(options.scene));
  MESORIG_RETURN_IF_ERROR(ApplySize(options.size, scene.image));
  if (!options.btf.empty()) scene.btf_file = options.btf;
  if (scene.btf_file.empty()) {
    return InvalidArgument("{}: names no BTF (`btf = \"FILE.btf.exr\"`) and --btf is not given",
                           options.scene.string());
  }
  return scene;
}

void Print(const Options& options, const nlohmann::json& figures) {
  if (options.json) {
    fmt::print("{}\n", figures.dump(2));
    return;
  }
  fmt::print("{}: {} x {} pixels, BTF {} ({})\n", options.out.string(),
             figures["width_px"].get<int>(), figures["height_px"].get<int>(),
             figures["btf"].get<std::string>(), figures["codec"].get<std::string>());
  fmt::print("{:.2f} ms a frame (median of {}) on {}\n", figures["ms_per_frame"].get<double>(),
             figures["frames"].get<int>(), figures["renderer"].get<std::string>());
  if (figures.contains("check")) {
    fmt::print("against the CPU over {} fragments: rel_error {:.2e}, largest difference {:.2e}\n",
               figures["check"]["fragments"].get<size_t>(),
               figures["check"]["rel_error"].get<double>(),
               figures["check"]["max_abs"].get<double>());
  }
}

Status Run(const Options& options) {
  MESORIG_ASSIGN_OR_RETURN(const Scene scene, LoadSceneFor(options));
  auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const BtfSource source, BtfSource::Load(scene.btf_file));
  const double load_ms = Milliseconds(start);
  MESORIG_ASSIGN_OR_RETURN(const GlContext context, GlContext::Create());
  start = std::chrono::steady_clock::now();
  auto created = SceneRenderer::Create(scene, source, context);
  if (!created.ok()) return Annotate(created.status(), scene.btf_file.string());
  SceneRenderer renderer = *std::move(created);
  const double upload_ms = Milliseconds(start);
  const Timing timing = DrawFrames(renderer, options.frames);
  MESORIG_ASSIGN_OR_RETURN(const Picture picture, renderer.ReadPicture());

  nlohmann::json figures = {{"scene", options.scene.string()},
                            {"btf", scene.btf_file.string()},
                            {"codec", source.codec()},
                            {"out", options.out.string()},
                            {"width_px", picture.width},
                            {"height_px", picture.height},
                            {"msaa", scene.image.msaa},
                            {"supersample", scene.image.supersample},
                            {"renderer", context.renderer_name()},
                            {"gl_version", context.version()},
                            {"load_ms", load_ms},
                            {"upload_ms", upload_ms},
                            {"first_frame_ms", timing.first_ms},
                            {"frames", timing.frames},
                            {"ms_per_frame", timing.ms_per_frame}};
  if (options.check > 0) {
    MESORIG_ASSIGN_OR_RETURN(const auto fragments, renderer.Probe());
    const CpuCheck check = CompareWithCpu(scene, source, fragments, options.check);
    figures["check"] = {{"fragments", check.fragments},
                        {"rel_error", check.rel_error},
                        {"max_abs", check.max_abs},
                        {"cpu_ms", check.cpu_ms}};
  }
  MESORIG_RETURN_IF_ERROR(WritePng(picture, options.out));
  Print(options, figures);
  return OkStatus();
}

}  // namespace
}  // namespace mesorig::renderer

int main(int argc, char** argv) {
  using namespace mesorig;
  renderer::Options options;
  CLI::App app(
      "Draws a scene file (scenes/*.toml) to a PNG: objects covered with a measured BTF under\n"
      "directional lights, and beside them the same with a plain texture. Needs no display; runs\n"
      "on a software rasteriser where there is no GPU.\n\n"
      "  mesorig-render scenes/torus.toml --btf sample.view-svd.btf.exr --out torus.png\n");
  app.add_option("scene", options.scene, "scene file (TOML)")->required();
  app.add_option("--out", options.out, "picture to write (.png)")->required();
  app.add_option("--btf", options.btf, "BTF file to use instead of the scene's (.btf.exr)");
  app.add_option("--size", options.size, "WIDTHxHEIGHT in pixels instead of the scene's");
  app.add_option("--frames", options.frames,
                 "frames to time after the first; ms_per_frame is their median")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--check", options.check,
                 "evaluate this many fragments on the CPU too and print the shader's error")
      ->check(CLI::Range(0, 10000000));
  app.add_flag("--json", options.json, "print the figures as JSON");
  return RunProgram(app, "mesorig-render", argc, argv, [&] { return renderer::Run(options); });
}
