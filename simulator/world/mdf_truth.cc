#include "simulator/world/mdf_truth.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <numeric>
#include <vector>

#include "protocol/base/file_writer.h"
#include "simulator/world/parallel.h"

namespace mesorig::world {
namespace {

// Row j of view v; returns how many rays passed by the sample.
size_t TraceRow(const World& world, int v, int j, btf::Mdf& mdf) {
  const btf::MdfHeader& header = mdf.header();
  const Vec3 view = header.views[v];
  const auto row = static_cast<size_t>(j) * static_cast<size_t>(header.width);
  size_t missed = 0;
  for (int i = 0; i < header.width; ++i) {
    const Vec3 p = header.TexelCentre(i, j);
    const auto hit = world.FirstHit(p, -view);
    const double d = hit ? Dot(p - hit->p, view) : header.h_ref_mm / view.z;
    const size_t texel = row + static_cast<size_t>(i);
    mdf.MutableDistance(v)[texel] = static_cast<float>(std::max(0.0, d));
    mdf.MutableConfidence(v)[texel] = hit ? 1.0f : 0.0f;
    missed += hit ? 0 : 1;
  }
  return missed;
}

}  // namespace

StatusOr<MdfTruth> ComputeMdfTruth(const World& world, const btf::MdfHeader& header, int threads,
                                   const std::function<void(double)>& progress) {
  MESORIG_RETURN_IF_ERROR(btf::CheckMdfHeader(header));
  if (!(header.h_ref_mm >= world.top_mm())) {
    return InvalidArgument("reference plane at {} mm: sample {} rises to {} mm", header.h_ref_mm,
                           world.surface().name, world.top_mm());
  }
  const auto start = std::chrono::steady_clock::now();
  MdfTruth truth{btf::Mdf(header)};
  std::vector<size_t> missed(static_cast<size_t>(header.height));
  for (int v = 0; v < header.view_count(); ++v) {
    ParallelFor(header.height, threads,
                [&](int j) { missed[j] = TraceRow(world, v, j, truth.mdf); });
    truth.missed += std::accumulate(missed.begin(), missed.end(), size_t{0});
    if (progress) progress((v + 1.0) / header.view_count());
  }
  truth.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return truth;
}

Status WriteMesh(const World& world, const std::filesystem::path& path) {
  const TriangleMesh mesh = world.Mesh();
  std::string text = fmt::format("# {}: {} vertices, {} triangles; mm, sample frame\n",
                                 world.surface().name, mesh.vertices.size(), mesh.triangles.size());
  for (const auto& v : mesh.vertices) {
    fmt::format_to(std::back_inserter(text), "v {} {} {}\n", v[0], v[1], v[2]);
  }
  for (const auto& t : mesh.triangles) {
    fmt::format_to(std::back_inserter(text), "f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  }
  return WriteFileAtomically(path, text);
}

}  // namespace mesorig::world
