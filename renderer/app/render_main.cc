// mesorig-render: draws a scene file to a PNG.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>

#include "processing/btf/mdf_file.h"
#include "protocol/base/program.h"
#include "renderer/app/comparison.h"
#include "renderer/gl/cpu_check.h"
#include "renderer/gl/scene_renderer.h"
#include "renderer/gl/silhouette_check.h"

namespace mesorig::renderer {
namespace {

struct Options {
  std::filesystem::path scene, out, btf, mdf, relief, compare;
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
  if (!options.mdf.empty()) scene.mdf_file = options.mdf;
  if (scene.mdf_file.empty() && scene.Uses(Material::kBtfMdf)) {
    return InvalidArgument(
        "{}: an object has the material \"btf+mdf\", but it names no MDF (`mdf = "
        "\"FILE.mdf.exr\"`) and --mdf is not given",
        options.scene.string());
  }
  if (!options.compare.empty() && options.relief.empty()) {
    return InvalidArgument("--compare needs --relief");
  }
  return scene;
}

// Null where no object has one.
StatusOr<std::optional<btf::Mdf>> LoadMdf(const Scene& scene) {
  if (!scene.Uses(Material::kBtfMdf)) return std::nullopt;
  MESORIG_ASSIGN_OR_RETURN(btf::Mdf mdf, btf::ReadMdf(scene.mdf_file));
  return mdf;
}

// The shaders against the CPU.
Status Check(const Options& options, const Scene& scene, const BtfSource& source,
             const btf::Mdf* mdf, const SceneRenderer& renderer, nlohmann::json& figures) {
  MESORIG_ASSIGN_OR_RETURN(const auto fragments, renderer.Probe());
  const CpuCheck check = CompareWithCpu(scene, source, fragments, options.check);
  figures["check"] = {{"fragments", check.fragments},
                      {"rel_error", check.rel_error},
                      {"max_abs", check.max_abs},
                      {"cpu_ms", check.cpu_ms}};
  if (mdf == nullptr) return OkStatus();
  MESORIG_ASSIGN_OR_RETURN(const SilhouetteCheck silhouettes,
                           CompareSilhouettesWithCpu(scene, *mdf, fragments, options.check));
  figures["silhouette_check"] = {{"pixels", silhouettes.pixels},
                                 {"differing", silhouettes.differing},
                                 {"worst_margin_mm", silhouettes.worst_margin_mm},
                                 {"cpu_ms", silhouettes.cpu_ms}};
  return OkStatus();
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
  if (figures.contains("silhouettes")) {
    fmt::print(
        "silhouettes from {}: {} peeling passes{}\n", figures["mdf"].get<std::string>(),
        figures["silhouettes"]["passes"].get<int>(),
        figures["silhouettes"]["exhausted"].get<bool>() ? ", more were needed (max_passes)" : "");
  }
  if (figures.contains("silhouette_iou")) {
    fmt::print(
        "silhouettes against the displaced surface, over {} pixels: IoU {:.3f}, BTF only {:.3f}\n",
        figures["band_pixels"].get<size_t>(), figures["silhouette_iou"].get<double>(),
        figures["silhouette_iou_btf_only"].get<double>());
  }
  if (figures.contains("silhouette_check")) {
    fmt::print("silhouettes against the CPU over {} pixels: {} differ\n",
               figures["silhouette_check"]["pixels"].get<size_t>(),
               figures["silhouette_check"]["differing"].get<size_t>());
  }
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
  MESORIG_ASSIGN_OR_RETURN(const std::optional<btf::Mdf> loaded_mdf, LoadMdf(scene));
  const btf::Mdf* mdf = loaded_mdf ? &*loaded_mdf : nullptr;
  const double load_ms = Milliseconds(start);
  MESORIG_ASSIGN_OR_RETURN(const GlContext context, GlContext::Create());
  start = std::chrono::steady_clock::now();
  auto created = SceneRenderer::Create(scene, source, context, mdf);
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
  if (mdf != nullptr) {
    const SilhouettePasses passes = renderer.silhouette_passes();
    figures["mdf"] = scene.mdf_file.string();
    figures["silhouettes"] = {{"passes", passes.passes}, {"exhausted", passes.exhausted}};
  }
  if (options.check > 0) {
    MESORIG_RETURN_IF_ERROR(Check(options, scene, source, mdf, renderer, figures));
  }
  if (!options.relief.empty()) {
    if (mdf == nullptr) {
      return InvalidArgument(
          "--relief compares silhouettes, but no object has the material \"btf+mdf\"");
    }
    MESORIG_ASSIGN_OR_RETURN(
        const nlohmann::json comparison,
        CompareSilhouettes({scene, source, *mdf, context, options.relief, options.compare}));
    figures.update(comparison);
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
      "directional lights, with the silhouettes of its relief where the scene says so (material\n"
      "\"btf+mdf\"), and beside them the same with a plain texture. Needs no display; runs on a\n"
      "software rasteriser where there is no GPU.\n\n"
      "  mesorig-render scenes/torus.toml --btf sample.view-svd.btf.exr --out torus.png\n"
      "  mesorig-render scenes/silhouette.toml --btf sample.view-svd.btf.exr --mdf sample.mdf.exr "
      "\\\n"
      "      --relief sample.obj --compare side-by-side.png --json --out silhouette.png\n\n"
      "With --relief (the true relief as a mesh) the scene is also ray-traced with its surfaces\n"
      "really displaced; silhouette_iou and silhouette_iou_btf_only say how near the drawn\n"
      "silhouettes come, over the pixels between the silhouette of the surface and that of the\n"
      "surface without the relief's largest depth.\n");
  app.add_option("scene", options.scene, "scene file (TOML)")->required();
  app.add_option("--out", options.out, "picture to write (.png)")->required();
  app.add_option("--btf", options.btf, "BTF file to use instead of the scene's (.btf.exr)");
  app.add_option("--mdf", options.mdf, "MDF file to use instead of the scene's (.mdf.exr)");
  app.add_option("--relief", options.relief,
                 "relief of the sample (Wavefront OBJ of triangles, mm, sample frame): trace the "
                 "displaced surface and compare silhouettes");
  app.add_option("--compare", options.compare,
                 "picture to write with --relief (.png): BTF only, BTF and MDF, traced, and a part "
                 "of each enlarged");
  app.add_option("--size", options.size, "WIDTHxHEIGHT in pixels instead of the scene's");
  app.add_option("--frames", options.frames,
                 "frames to time after the first; ms_per_frame is their median")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option(
         "--check", options.check,
         "evaluate this many fragments (and silhouette pixels) on the CPU too and print the "
         "shaders' error")
      ->check(CLI::Range(0, 10000000));
  app.add_flag("--json", options.json, "print the figures as JSON");
  return RunProgram(app, "mesorig-render", argc, argv, [&] { return renderer::Run(options); });
}
