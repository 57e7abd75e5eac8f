#include "renderer/gl/silhouette_check.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "renderer/scene/view_transform.h"

namespace mesorig::renderer {
namespace {

// As in shaders/mdf.glsl.
constexpr double kFlattest = 1e-3, kFlat = 0.04;
constexpr int kBendSteps = 8;

int Wrapped(double index, int size) {
  const double rest = index - std::floor(index / size) * size;
  return static_cast<int>(rest) % size;
}

// Solves M x = v for the matrix with columns a, b, c (Cramer). Zero where it is singular.
Vec3 Solve(Vec3 a, Vec3 b, Vec3 c, Vec3 v) {
  const double determinant = Dot(a, Cross(b, c));
  if (!(determinant > 1e-5 * Norm(a) * Norm(b) * Norm(c))) return {};
  return 1 / determinant * Vec3{Dot(v, Cross(b, c)), Dot(a, Cross(v, c)), Dot(a, Cross(b, v))};
}

Vec3 Mix(const std::array<Vec3, 3>& values, double b, double c) {
  return (1 - b - c) * values[0] + b * values[1] + c * values[2];
}

template <typename Floats>
Vec3 ToVec3(const Floats& v) {
  return {v[0], v[1], v[2]};
}

}  // namespace

StatusOr<CpuSilhouette> CpuSilhouette::Create(const Scene& scene, size_t object,
                                              const btf::Mdf& mdf) {
  const btf::MdfHeader& header = mdf.header();
  CpuSilhouette result(mdf);
  MESORIG_ASSIGN_OR_RETURN(result.views_, btf::DirectionInterpolator::Build(header.views));
  result.scene_ = scene;
  result.step_mm_ = StepMm(scene.silhouettes, header);
  const Object& of = scene.objects.at(object);
  const double width_mm = header.width * header.pitch_mm;
  const double height_mm = header.height * header.pitch_mm;
  MESORIG_ASSIGN_OR_RETURN(const TextureScale scale,
                           ScaleTexture(of, width_mm, height_mm / width_mm));
  result.x_mm_ = scale.x * width_mm;
  result.y_mm_ = scale.y * height_mm;
  const Mesh mesh = MakeMesh(of);
  const std::vector<Stretch> stretch = StretchOf(mesh);
  const RigidTransform place = Placement(of);
  for (size_t i = 0; i < mesh.indices.size(); i += 3) {
    Triangle& triangle = result.triangles_.emplace_back();
    for (size_t k = 0; k < 3; ++k) {
      const size_t index = mesh.indices[i + k];
      const Vertex& vertex = mesh.vertices[index];
      triangle.p[k] = place * ToVec3(vertex.position);
      triangle.normal[k] = place.rotation * ToVec3(vertex.normal);
      triangle.along_x[k] = place.rotation * ToVec3(stretch[index].along_x);
      triangle.along_y[k] = place.rotation * ToVec3(stretch[index].along_y);
      triangle.uv[k] = {0.5 + scale.x * vertex.texture_mm[0], 0.5 - scale.y * vertex.texture_mm[1]};
    }
  }
  return result;
}

CpuSilhouette::Crossing CpuSilhouette::Interpolate(const Triangle& triangle, double b, double c,
                                                   Vec3 away, double t) const {
  Crossing crossing;
  crossing.t = t;
  const auto& uv = triangle.uv;
  crossing.u = (1 - b - c) * uv[0][0] + b * uv[1][0] + c * uv[2][0];
  crossing.v = (1 - b - c) * uv[0][1] + b * uv[1][1] + c * uv[2][1];
  const Vec3 n = Normalized(Mix(triangle.normal, b, c));
  Vec3 x = 1 / x_mm_ * Mix(triangle.along_x, b, c), y = 1 / y_mm_ * Mix(triangle.along_y, b, c);
  x = x - Dot(x, n) * n;
  y = y - Dot(y, n) * n;
  crossing.cosine = std::max(Dot(away, n), kFlattest);
  crossing.toward = Solve(x, y, std::sqrt(Norm(Cross(x, y))) * n, away);
  return crossing;
}

// Ascending distance. A ray through an edge that two triangles share crosses once.
std::vector<CpuSilhouette::Crossing> CpuSilhouette::Crossings(Vec3 direction) const {
  const Vec3 eye = scene_.camera.eye_mm;
  std::vector<Crossing> crossings;
  for (const Triangle& triangle : triangles_) {
    const Vec3 e1 = triangle.p[1] - triangle.p[0], e2 = triangle.p[2] - triangle.p[0];
    const Vec3 h = Cross(direction, e2);
    const double determinant = Dot(e1, h);
    if (determinant == 0) continue;
    const Vec3 s = eye - triangle.p[0];
    const double b = Dot(s, h) / determinant;
    if (!(b >= 0 && b <= 1)) continue;
    const Vec3 q = Cross(s, e1);
    const double c = Dot(direction, q) / determinant;
    if (!(c >= 0 && b + c <= 1)) continue;
    const double t = Dot(e2, q) / determinant;
    if (!(t > 0)) continue;
    const bool front = Dot(direction, Cross(e1, e2)) < 0;
    Crossing crossing = Interpolate(triangle, b, c, front ? -direction : direction, t);
    crossing.front = front;
    const bool known = std::any_of(crossings.begin(), crossings.end(), [&](const Crossing& other) {
      return other.front == front && std::abs(other.t - t) < 1e-7 * t;
    });
    if (!known) crossings.push_back(crossing);
  }
  std::sort(crossings.begin(), crossings.end(),
            [](const Crossing& a, const Crossing& b) { return a.t < b.t; });
  return crossings;
}

double CpuSilhouette::DepthBetween(double u, double v, const btf::DirectionWeights& views) const {
  const btf::MdfHeader& header = mdf_->header();
  const double x = u * header.width - 0.5, y = v * header.height - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  struct Sample {
    double weight, depth;
  };
  std::vector<Sample> samples;
  for (size_t i = 0; i < 3; ++i) {
    for (int k = 0; k < 4; ++k) {
      const int dx = k % 2, dy = k / 2;
      const int column = Wrapped(x0 + dx, header.width), row = Wrapped(y0 + dy, header.height);
      const double of_texel = (dx ? x - x0 : 1 - (x - x0)) * (dy ? y - y0 : 1 - (y - y0));
      const float distance =
          mdf_->Distance(views.index[i])[static_cast<size_t>(row * header.width + column)];
      samples.push_back({views.weight[i] * of_texel,
                         distance * header.views[static_cast<size_t>(views.index[i])].z});
    }
  }
  double heaviest = 0, layer = 0;
  for (const Sample& candidate : samples) {
    double mass = 0;
    for (const Sample& sample : samples) {
      if (std::abs(sample.depth - candidate.depth) <= step_mm_) mass += sample.weight;
    }
    if (candidate.weight > 0 && mass > heaviest + 1e-4) {
      heaviest = mass;
      layer = candidate.depth;
    }
  }
  double sum = 0, weights = 0;
  for (const Sample& sample : samples) {
    if (std::abs(sample.depth - layer) > step_mm_) continue;
    sum += sample.weight * sample.depth;
    weights += sample.weight;
  }
  return sum / weights;
}

double CpuSilhouette::DistanceAlong(double u, double v, Vec3 toward) const {
  const double stretched = Norm(toward);
  if (!(stretched > 0)) return 0;
  const Vec3 d = 1 / stretched * toward;
  const btf::DirectionWeights views = views_->Lookup(d);
  Vec3 direction;
  for (size_t i = 0; i < 3; ++i) {
    direction = direction +
                double{views.weight[i]} * views_->directions()[static_cast<size_t>(views.index[i])];
  }
  return DepthBetween(u, v, views) / (Normalized(direction).z * stretched);
}

double CpuSilhouette::Descend(const Crossing& from, const Crossing& other, double chord) const {
  double t = DistanceAlong(from.u, from.v, from.toward);
  if (!(t > kFlat * chord) || !(chord > 0) || !scene_.silhouettes.follow_curvature) return t;
  for (int i = 0; i < kBendSteps; ++i) {
    const double s = std::min(t / chord, 0.5);
    const double slope = (1 - s) * ((1 - s) * from.cosine + s * other.cosine) / from.cosine;
    const double next =
        DistanceAlong(from.u, from.v, {from.toward.x, from.toward.y, from.toward.z * slope});
    if (std::abs(next - t) <= 2e-3 * t) return next;
    t = next;
  }
  return t;
}

CpuSilhouette::Result CpuSilhouette::At(double x, double y) const {
  Result result;
  result.margin = std::numeric_limits<double>::infinity();
  const std::vector<Crossing> crossings =
      Crossings(RayThrough(scene_.camera, scene_.image.width, scene_.image.height, x, y));
  for (size_t i = 0; i + 1 < crossings.size(); ++i) {
    const Crossing& front = crossings[i];
    const Crossing& back = crossings[i + 1];
    if (!front.front || back.front) continue;
    ++result.intervals;
    if (result.hit) continue;
    const double chord = back.t - front.t;
    const double d_front = Descend(front, back, chord), d_back = Descend(back, front, chord);
    result.margin = std::min(result.margin, std::abs(chord - d_front - d_back));
    if (d_front + d_back <= chord) {
      result.hit = true;
      result.interval = result.intervals - 1;
      result.distance = front.t;
      result.to_relief = d_front;
    }
  }
  return result;
}

StatusOr<SilhouetteCheck> CompareSilhouettesWithCpu(const Scene& scene, const btf::Mdf& mdf,
                                                    const std::vector<Fragment>& fragments,
                                                    size_t most) {
  const int width = scene.image.width, height = scene.image.height;
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  std::vector<int> seen(pixels, -1);
  for (const Fragment& fragment : fragments) {
    seen[static_cast<size_t>(fragment.y * width + fragment.x)] = fragment.object;
  }
  std::vector<std::pair<int, CpuSilhouette>> objects;
  for (size_t i = 0; i < scene.objects.size(); ++i) {
    if (scene.objects[i].material != Material::kBtfMdf) continue;
    MESORIG_ASSIGN_OR_RETURN(CpuSilhouette silhouette, CpuSilhouette::Create(scene, i, mdf));
    objects.emplace_back(static_cast<int>(i), std::move(silhouette));
  }
  SilhouetteCheck check;
  if (objects.empty()) return check;
  check.pixels = std::min(most, pixels);
  const auto start = std::chrono::steady_clock::now();
  for (size_t i = 0; i < check.pixels; ++i) {
    const size_t pixel = i * pixels / check.pixels;
    const double x = static_cast<double>(pixel % static_cast<size_t>(width)) + 0.5;
    const double y = static_cast<double>(pixel / static_cast<size_t>(width)) + 0.5;
    bool differs = false;
    double margin = 0;
    for (const auto& [number, silhouette] : objects) {
      const CpuSilhouette::Result cpu = silhouette.At(x, y);
      const bool wrong = cpu.hit ? seen[pixel] < 0 : seen[pixel] == number;
      differs = differs || wrong;
      if (wrong && std::isfinite(cpu.margin)) margin = std::max(margin, cpu.margin);
    }
    if (differs) {
      ++check.differing;
      check.worst_margin_mm = std::max(check.worst_margin_mm, margin);
    }
  }
  check.cpu_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return check;
}

}  // namespace mesorig::renderer
