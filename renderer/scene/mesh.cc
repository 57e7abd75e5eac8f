#include "renderer/scene/mesh.h"

#include <algorithm>
#include <cmath>

namespace mesorig::renderer {
namespace {

Vertex MakeVertex(Vec3 p, Vec3 normal, Vec3 tangent, double x_mm, double y_mm) {
  const auto f = [](double value) { return static_cast<float>(value); };
  return {{f(p.x), f(p.y), f(p.z)},
          {f(normal.x), f(normal.y), f(normal.z)},
          {f(tangent.x), f(tangent.y), f(tangent.z)},
          {f(x_mm), f(y_mm)}};
}

// Two triangles a cell of a grid of (columns + 1) x (rows + 1) vertices that starts at `first`,
// row by row; counter-clockwise when +column x +row points outwards.
void AddGrid(Mesh& mesh, size_t first, size_t columns, size_t rows) {
  for (size_t j = 0; j < rows; ++j) {
    for (size_t i = 0; i < columns; ++i) {
      const auto a = static_cast<uint32_t>(first + j * (columns + 1) + i);
      const auto b = static_cast<uint32_t>(a + columns + 1);
      mesh.indices.insert(mesh.indices.end(), {a, a + 1, b + 1, a, b + 1, b});
    }
  }
}

// One side of the slab: the frame (x, y, normal) of its texture, half lengths along them, and the
// texture coordinates of its middle.
struct Side {
  Vec3 x, y, normal;
  double half_x, half_y, half_normal;
  double middle_x_mm, middle_y_mm;
};

// Where along one axis of a side a grid line lies: `flat` on the flat part, then `angle` around the
// edge (up to 45 degrees on this side), `length_mm` from the middle along the surface.
struct GridLine {
  double flat_mm, angle_rad, length_mm;
};

std::vector<GridLine> GridLines(double half_mm, double rounding_mm) {
  const double flat = half_mm - rounding_mm;
  if (rounding_mm <= 0) return {{-flat, 0, -flat}, {flat, 0, flat}};
  constexpr int kArc = 8;
  std::vector<GridLine> lines;
  for (int i = -kArc; i <= kArc; ++i) {
    const double angle = kPi / 4 * i / kArc;
    const double side = i < 0 ? -flat : flat;
    if (i == 0) {
      lines.push_back({-flat, 0, -flat});
      lines.push_back({flat, 0, flat});
    } else {
      lines.push_back({side, angle, side + angle * rounding_mm});
    }
  }
  return lines;
}

// Length from the middle of a side to the edge it shares with its neighbour, over the surface.
double HalfLength(double half_mm, double rounding_mm) {
  return half_mm - rounding_mm + kPi / 4 * rounding_mm;
}

void AddSide(Mesh& mesh, const Side& side, double rounding_mm) {
  const std::vector<GridLine> columns = GridLines(side.half_x, rounding_mm);
  const std::vector<GridLine> rows = GridLines(side.half_y, rounding_mm);
  const size_t first = mesh.vertices.size();
  for (const GridLine& row : rows) {
    for (const GridLine& column : columns) {
      const double tx = std::tan(column.angle_rad), ty = std::tan(row.angle_rad);
      const Vec3 normal = Normalized(side.normal + tx * side.x + ty * side.y);
      const Vec3 p = (side.half_normal - rounding_mm) * side.normal + column.flat_mm * side.x +
                     row.flat_mm * side.y + rounding_mm * normal;
      const Vec3 tangent = Normalized(side.x - Dot(side.x, normal) * normal);
      mesh.vertices.push_back(MakeVertex(p, normal, tangent, side.middle_x_mm + column.length_mm,
                                         side.middle_y_mm + row.length_mm));
    }
  }
  AddGrid(mesh, first, columns.size() - 1, rows.size() - 1);
}

}  // namespace

Mesh MakeTorus(double major_radius_mm, double minor_radius_mm, int major_segments,
               int minor_segments) {
  Mesh mesh;
  for (int j = 0; j <= minor_segments; ++j) {
    const double phi = 2 * kPi * j / minor_segments - kPi;
    for (int i = 0; i <= major_segments; ++i) {
      const double theta = 2 * kPi * i / major_segments - kPi;
      const Vec3 outwards{std::cos(theta), std::sin(theta), 0};
      const Vec3 along{-std::sin(theta), std::cos(theta), 0};
      const Vec3 normal = std::cos(phi) * outwards + Vec3{0, 0, std::sin(phi)};
      const Vec3 p = major_radius_mm * outwards + minor_radius_mm * normal;
      mesh.vertices.push_back(
          MakeVertex(p, normal, along, major_radius_mm * theta, minor_radius_mm * phi));
    }
  }
  // d/dtheta x d/dphi points outwards.
  AddGrid(mesh, 0, static_cast<size_t>(major_segments), static_cast<size_t>(minor_segments));
  return mesh;
}

Mesh MakeSlab(Vec3 size_mm, double rounding_mm) {
  const Vec3 half = 0.5 * size_mm;
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  const double lx = HalfLength(half.x, rounding_mm), ly = HalfLength(half.y, rounding_mm),
               lz = HalfLength(half.z, rounding_mm);
  Mesh mesh;
  for (const Side& side : {
           Side{x, y, z, half.x, half.y, half.z, 0, 0},
           Side{x, z, -y, half.x, half.z, half.y, 0, -ly - lz},
           Side{x, -z, y, half.x, half.z, half.y, 0, ly + lz},
           Side{-z, y, x, half.z, half.y, half.x, lx + lz, 0},
           Side{z, y, -x, half.z, half.y, half.x, -lx - lz, 0},
           Side{x, -y, -z, half.x, half.y, half.z, 0, -2 * ly - 2 * lz},
       }) {
    AddSide(mesh, side, rounding_mm);
  }
  return mesh;
}

Mesh MakeMesh(const Object& object) {
  if (object.shape == Shape::kTorus) {
    return MakeTorus(object.major_radius_mm, object.minor_radius_mm, 144, 72);
  }
  return MakeSlab(object.size_mm, object.rounding_mm);
}

namespace {

Vec3 ToVec3(const float (&v)[3]) { return {v[0], v[1], v[2]}; }

void Store(Vec3 from, float (&to)[3]) {
  to[0] = static_cast<float>(from.x);
  to[1] = static_cast<float>(from.y);
  to[2] = static_cast<float>(from.z);
}

}  // namespace

std::vector<Stretch> StretchOf(const Mesh& mesh) {
  std::vector<Vec3> along_x(mesh.vertices.size()), along_y(mesh.vertices.size());
  std::vector<double> weight(mesh.vertices.size());
  for (size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    const Vertex& a = mesh.vertices[mesh.indices[i]];
    const Vertex& b = mesh.vertices[mesh.indices[i + 1]];
    const Vertex& c = mesh.vertices[mesh.indices[i + 2]];
    const double x1 = b.texture_mm[0] - a.texture_mm[0], y1 = b.texture_mm[1] - a.texture_mm[1];
    const double x2 = c.texture_mm[0] - a.texture_mm[0], y2 = c.texture_mm[1] - a.texture_mm[1];
    const double area = x1 * y2 - x2 * y1;
    // A sliver's derivatives are rounding: what remains of cancelled products.
    if (!(std::abs(area) > 1e-5 * std::hypot(x1, y1) * std::hypot(x2, y2))) continue;
    const Vec3 ab = ToVec3(b.position) - ToVec3(a.position);
    const Vec3 ac = ToVec3(c.position) - ToVec3(a.position);
    // Times the area, which is also the weight.
    const double sign = area > 0 ? 1 : -1;
    const Vec3 x = sign * (y2 * ab - y1 * ac), y = sign * (x1 * ac - x2 * ab);
    for (size_t k = 0; k < 3; ++k) {
      const size_t vertex = mesh.indices[i + k];
      along_x[vertex] = along_x[vertex] + x;
      along_y[vertex] = along_y[vertex] + y;
      weight[vertex] += std::abs(area);
    }
  }
  std::vector<Stretch> result(mesh.vertices.size());
  for (size_t i = 0; i < result.size(); ++i) {
    const double scale = weight[i] > 0 ? 1 / weight[i] : 0;
    Store(scale * along_x[i], result[i].along_x);
    Store(scale * along_y[i], result[i].along_y);
  }
  return result;
}

double HeightScale(const Stretch& stretch) {
  return std::sqrt(Norm(Cross(ToVec3(stretch.along_x), ToVec3(stretch.along_y))));
}

RigidTransform Placement(const Object& object) {
  const Vec3 r = object.rotation_rad;
  return {RotationAbout({0, 0, 1}, r.z) *
              (RotationAbout({0, 1, 0}, r.y) * RotationAbout({1, 0, 0}, r.x)),
          object.position_mm};
}

StatusOr<TextureScale> ScaleTexture(const Object& object, double width_mm, double aspect) {
  const double unit_mm = object.mm_per_unit > 0 ? object.mm_per_unit : width_mm;
  if (!(unit_mm > 0)) {
    return InvalidArgument(
        "the BTF does not know its texel pitch (0 mm): give mm_per_unit in "
        "[[object]], millimetres of the surface a repeat of the sample covers");
  }
  TextureScale scale{1 / unit_mm, 1 / (unit_mm * aspect)};
  if (object.shape == Shape::kTorus && object.whole_repeats) {
    const double around_major = 2 * kPi * object.major_radius_mm;
    const double around_minor = 2 * kPi * object.minor_radius_mm;
    scale.x = std::max(1.0, std::round(around_major * scale.x)) / around_major;
    scale.y = std::max(1.0, std::round(around_minor * scale.y)) / around_minor;
  }
  return scale;
}

}  // namespace mesorig::renderer
