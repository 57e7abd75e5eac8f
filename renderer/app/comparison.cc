#include "renderer/app/comparison.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "renderer/tracer/relief.h"
#include "renderer/tracer/silhouette_figures.h"

namespace mesorig::renderer {
namespace {

using Mask = std::vector<uint8_t>;

// Triangles that all displaced objects together are cut into, about.
constexpr double kTriangles = 1.5e6;
constexpr int kGap = 8;    // pixels between the pictures
constexpr int kCrops = 5;  // a crop is this part of the picture, each way

class Stopwatch {
 public:
  double LapMs() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

Scene WithoutMdf(Scene scene) {
  for (Object& object : scene.objects) {
    if (object.material == Material::kBtfMdf) object.material = Material::kBtf;
  }
  return scene;
}

Scene OnlyMdfObjects(Scene scene) {
  std::erase_if(scene.objects,
                [](const Object& object) { return object.material != Material::kBtfMdf; });
  return scene;
}

StatusOr<Mask> DrawnMask(const ComparisonInput& input, const Scene& scene) {
  MESORIG_ASSIGN_OR_RETURN(const SceneRenderer renderer,
                           SceneRenderer::Create(scene, input.source, input.context, &input.mdf));
  MESORIG_ASSIGN_OR_RETURN(const auto fragments, renderer.Probe());
  Mask mask(static_cast<size_t>(scene.image.width) * static_cast<size_t>(scene.image.height));
  for (const Fragment& f : fragments) {
    mask[static_cast<size_t>(f.y) * static_cast<size_t>(scene.image.width) +
         static_cast<size_t>(f.x)] = 1;
  }
  return mask;
}

StatusOr<Picture> DrawnPicture(const ComparisonInput& input, const Scene& scene) {
  MESORIG_ASSIGN_OR_RETURN(SceneRenderer renderer,
                           SceneRenderer::Create(scene, input.source, input.context, &input.mdf));
  renderer.Draw();
  return renderer.ReadPicture();
}

// The scene's objects, those with an MDF displaced by `height`.
StatusOr<Tracer> TracerOf(const ComparisonInput& input, const Scene& scene,
                          const HeightFunction& height, double max_edge_mm) {
  const btf::MdfHeader& header = input.mdf.header();
  const SampleSize sample{header.width * header.pitch_mm, header.height * header.pitch_mm};
  std::vector<SurfaceMesh> surfaces;
  for (const Object& object : scene.objects) {
    MESORIG_ASSIGN_OR_RETURN(
        const TextureScale scale,
        ScaleTexture(object, sample.width_mm, sample.height_mm / sample.width_mm));
    const bool displaced = object.material == Material::kBtfMdf && height;
    MESORIG_ASSIGN_OR_RETURN(
        SurfaceMesh surface,
        DisplaceSurface(object, scale, sample, displaced ? height : HeightFunction(),
                        displaced ? max_edge_mm : 1e9));
    surfaces.push_back(std::move(surface));
  }
  return Tracer::Create(std::move(surfaces));
}

// Top left corner of the crop that holds most pixels of `a` that are not of `b`.
std::array<int, 2> WhereMostDiffers(const Mask& a, const Mask& b, int width, int height,
                                    int crop_width, int crop_height) {
  const auto stride = static_cast<size_t>(width) + 1;
  std::vector<int> sums(stride * (static_cast<size_t>(height) + 1));  // over all rows above, ...
  for (size_t y = 0; y < static_cast<size_t>(height); ++y) {
    int row = 0;
    for (size_t x = 0; x < static_cast<size_t>(width); ++x) {
      const size_t at = y * static_cast<size_t>(width) + x;
      if (a[at] != 0 && b[at] == 0) ++row;
      sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
    }
  }
  std::array<int, 2> best{};
  int most = -1;
  for (int y = 0; y + crop_height <= height; ++y) {
    for (int x = 0; x + crop_width <= width; ++x) {
      const auto at = [&](int i, int j) {
        return sums[static_cast<size_t>(j) * stride + static_cast<size_t>(i)];
      };
      const int count = at(x + crop_width, y + crop_height) - at(x, y + crop_height) -
                        at(x + crop_width, y) + at(x, y);
      if (count > most) most = count, best = {x, y};
    }
  }
  return best;
}

// The pictures in a row, below them the same crop of each, as large as a picture.
Picture SideBySide(const std::vector<Picture>& pictures, std::array<int, 2> crop, int enlarge) {
  const int width = pictures[0].width, height = pictures[0].height;
  const int count = static_cast<int>(pictures.size());
  Picture result{count * width + (count - 1) * kGap, 2 * height + kGap, {}};
  result.rgb.assign(static_cast<size_t>(result.width) * static_cast<size_t>(result.height) * 3,
                    255);
  for (int i = 0; i < count; ++i) {
    const auto& from = pictures[static_cast<size_t>(i)].rgb;
    for (int y = 0; y < 2 * height; ++y) {
      for (int x = 0; x < width; ++x) {
        const bool below = y >= height;
        const int fx = below ? std::min(crop[0] + x / enlarge, width - 1) : x;
        const int fy = below ? std::min(crop[1] + (y - height) / enlarge, height - 1) : y;
        const auto source =
            (static_cast<size_t>(fy) * static_cast<size_t>(width) + static_cast<size_t>(fx)) * 3;
        const auto target =
            (static_cast<size_t>(y + (below ? kGap : 0)) * static_cast<size_t>(result.width) +
             static_cast<size_t>(i * (width + kGap) + x)) *
            3;
        for (size_t c = 0; c < 3; ++c) result.rgb[target + c] = from[source + c];
      }
    }
  }
  return result;
}

struct Masks {
  Mask base, shrunk, truth, btf_only, with_mdf;
};

Status WritePictures(const ComparisonInput& input, const Masks& masks, const Tracer& displaced) {
  MESORIG_ASSIGN_OR_RETURN(const std::vector<float> albedo, input.source.PlainTexture());
  const btf::BtfHeader& header = input.source.header();
  std::vector<Picture> pictures;
  for (const Scene& scene : {WithoutMdf(input.scene), input.scene}) {
    MESORIG_ASSIGN_OR_RETURN(Picture picture, DrawnPicture(input, scene));
    pictures.push_back(std::move(picture));
  }
  pictures.push_back(displaced.Draw(input.scene, {header.width, header.height, albedo}));
  const int width = pictures[0].width, height = pictures[0].height;
  const auto crop =
      WhereMostDiffers(masks.base, masks.truth, width, height, width / kCrops, height / kCrops);
  return WritePng(SideBySide(pictures, crop, kCrops), input.picture);
}

}  // namespace

StatusOr<nlohmann::json> CompareSilhouettes(const ComparisonInput& input) {
  const Scene scene = OnlyMdfObjects(input.scene);
  if (scene.objects.empty()) {
    return InvalidArgument(
        "--relief compares silhouettes, but no object has the material \"btf+mdf\"");
  }
  const btf::MdfHeader& header = input.mdf.header();
  Stopwatch watch;
  nlohmann::json figures;
  MESORIG_ASSIGN_OR_RETURN(const ReliefMesh mesh, ReadRelief(input.relief));
  auto created =
      Relief::Create(mesh, header.width * header.pitch_mm, header.height * header.pitch_mm);
  if (!created.ok()) return Annotate(created.status(), input.relief.string());
  const Relief relief = *std::move(created);
  const double depth = header.h_ref_mm - relief.lowest_mm();
  if (!(depth > 0)) {
    return InvalidArgument(
        "{}: its lowest point is at {} mm; permitted is below the MDF's reference "
        "plane, {} mm",
        input.relief.string(), relief.lowest_mm(), header.h_ref_mm);
  }
  figures["relief_depth_mm"] = depth;
  figures["relief_load_ms"] = watch.LapMs();

  double area = 0;
  for (const Object& object : scene.objects) area += SurfaceArea(object);
  // Halving leaves edges between this and half of it.
  const double max_edge_mm = std::sqrt(area / kTriangles / 0.2);
  const HeightFunction height = [&](double x, double y) {
    return relief.HeightAt(x, y) - header.h_ref_mm;
  };
  MESORIG_ASSIGN_OR_RETURN(const Tracer truth, TracerOf(input, scene, height, max_edge_mm));
  MESORIG_ASSIGN_OR_RETURN(const Tracer base, TracerOf(input, scene, nullptr, 1e9));
  MESORIG_ASSIGN_OR_RETURN(const Tracer shrunk,
                           TracerOf(
                               input, scene, [&](double, double) { return -depth; }, 1e9));
  figures["traced_triangles"] = truth.triangle_count();
  figures["trace_build_ms"] = watch.LapMs();
  Masks masks{base.Mask(scene), shrunk.Mask(scene), truth.Mask(scene), {}, {}};
  figures["trace_masks_ms"] = watch.LapMs();
  MESORIG_ASSIGN_OR_RETURN(masks.with_mdf, DrawnMask(input, scene));
  figures["mask_ms"] = watch.LapMs();
  MESORIG_ASSIGN_OR_RETURN(masks.btf_only, DrawnMask(input, WithoutMdf(scene)));
  figures["mask_btf_only_ms"] = watch.LapMs();

  MESORIG_ASSIGN_OR_RETURN(const BandFigures with_mdf,
                           CompareInBand(masks.base, masks.shrunk, masks.truth, masks.with_mdf));
  MESORIG_ASSIGN_OR_RETURN(const BandFigures btf_only,
                           CompareInBand(masks.base, masks.shrunk, masks.truth, masks.btf_only));
  figures["silhouette_iou"] = with_mdf.iou;
  figures["silhouette_iou_btf_only"] = btf_only.iou;
  figures["band_pixels"] = with_mdf.band_pixels;
  if (!input.picture.empty()) {
    // With the objects that have no MDF, too.
    std::optional<Tracer> all;
    if (scene.objects.size() != input.scene.objects.size()) {
      MESORIG_ASSIGN_OR_RETURN(all, TracerOf(input, input.scene, height, max_edge_mm));
    }
    MESORIG_RETURN_IF_ERROR(WritePictures(input, masks, all ? *all : truth));
    figures["picture"] = input.picture.string();
    figures["pictures_ms"] = watch.LapMs();
  }
  return figures;
}

}  // namespace mesorig::renderer
