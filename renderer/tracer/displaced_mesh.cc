#include "renderer/tracer/displaced_mesh.h"

#include <cmath>

namespace mesorig::renderer {
namespace {

constexpr size_t kMaxTriangles = 20'000'000;

template <typename Floats>
Vec3 ToVec3(const Floats& v) {
  return {v[0], v[1], v[2]};
}

// A corner before its displacement, in the object's frame. Halfway between two it is the same from
// both sides, so that neighbouring triangles meet.
struct Corner {
  Vec3 p, normal, along_x, along_y;
  double x_mm = 0, y_mm = 0;  // of the texture
};

Corner Halfway(const Corner& a, const Corner& b) {
  return {0.5 * (a.p + b.p),
          0.5 * (a.normal + b.normal),
          0.5 * (a.along_x + b.along_x),
          0.5 * (a.along_y + b.along_y),
          0.5 * (a.x_mm + b.x_mm),
          0.5 * (a.y_mm + b.y_mm)};
}

class Displacer {
 public:
  Displacer(RigidTransform place, TextureScale scale, SampleSize sample,
            const HeightFunction& height, double max_edge_mm)
      : place_(place), scale_(scale), sample_(sample), height_(height), max_edge_(max_edge_mm) {}

  void Add(const Corner& a, const Corner& b, const Corner& c) {
    if (mesh_.triangles.size() >= kMaxTriangles) return;
    const bool ab = IsLong(a, b), bc = IsLong(b, c), ca = IsLong(c, a);
    if (ab && bc && ca) {
      const Corner d = Halfway(a, b), e = Halfway(b, c), f = Halfway(c, a);
      Add(a, d, f);
      Add(d, b, e);
      Add(f, e, c);
      Add(d, e, f);
    } else if (ab) {
      const Corner d = Halfway(a, b);
      Add(a, d, c);
      Add(d, b, c);
    } else if (bc) {
      Add(b, c, a);
    } else if (ca) {
      Add(c, a, b);
    } else {
      const auto first = static_cast<uint32_t>(mesh_.vertices.size());
      for (const Corner* corner : {&a, &b, &c}) AddVertex(*corner);
      mesh_.triangles.push_back({first, first + 1, first + 2});
    }
  }
  SurfaceMesh& mesh() { return mesh_; }

 private:
  bool IsLong(const Corner& a, const Corner& b) const { return Norm(a.p - b.p) > max_edge_; }

  void AddVertex(const Corner& corner) {
    const double u = 0.5 + scale_.x * corner.x_mm, v = 0.5 - scale_.y * corner.y_mm;
    Vec3 p = corner.p;
    if (height_) {
      // Surface millimetres a millimetre of the sample, squared.
      const double area = Norm(Cross(corner.along_x, corner.along_y)) /
                          (scale_.x * sample_.width_mm * scale_.y * sample_.height_mm);
      const double h = height_((u - std::floor(u) - 0.5) * sample_.width_mm,
                               (0.5 - (v - std::floor(v))) * sample_.height_mm);
      p = p + std::sqrt(area) * h * Normalized(corner.normal);
    }
    p = place_ * p;
    mesh_.vertices.push_back(
        {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
    mesh_.uv.push_back({static_cast<float>(u), static_cast<float>(v)});
  }

  RigidTransform place_;
  TextureScale scale_;
  SampleSize sample_;
  const HeightFunction& height_;
  double max_edge_;
  SurfaceMesh mesh_;
};

}  // namespace

StatusOr<SurfaceMesh> DisplaceSurface(const Object& object, TextureScale scale, SampleSize sample,
                                      const HeightFunction& height, double max_edge_mm) {
  if (!(max_edge_mm > 0)) {
    return InvalidArgument("the displaced surface's edges: {} mm; permitted is above 0",
                           max_edge_mm);
  }
  const Mesh mesh = MakeMesh(object);
  const std::vector<Stretch> stretch = StretchOf(mesh);
  std::vector<Corner> corners;
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vertex& vertex = mesh.vertices[i];
    corners.push_back({ToVec3(vertex.position), ToVec3(vertex.normal), ToVec3(stretch[i].along_x),
                       ToVec3(stretch[i].along_y), vertex.texture_mm[0], vertex.texture_mm[1]});
  }
  Displacer displacer(Placement(object), scale, sample, height, max_edge_mm);
  for (size_t i = 0; i < mesh.indices.size(); i += 3) {
    displacer.Add(corners[mesh.indices[i]], corners[mesh.indices[i + 1]],
                  corners[mesh.indices[i + 2]]);
  }
  if (displacer.mesh().triangles.size() >= kMaxTriangles) {
    return InvalidArgument("a surface of {:.0f} mm^2 in triangles of {} mm: more than {} of them",
                           SurfaceArea(object), max_edge_mm, kMaxTriangles);
  }
  return std::move(displacer.mesh());
}

double SurfaceArea(const Object& object) {
  const Mesh mesh = MakeMesh(object);
  double area = 0;
  for (size_t i = 0; i < mesh.indices.size(); i += 3) {
    const Vec3 a = ToVec3(mesh.vertices[mesh.indices[i]].position);
    area += Norm(Cross(ToVec3(mesh.vertices[mesh.indices[i + 1]].position) - a,
                       ToVec3(mesh.vertices[mesh.indices[i + 2]].position) - a)) /
            2;
  }
  return area;
}

}  // namespace mesorig::renderer
