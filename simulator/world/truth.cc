#include "simulator/world/truth.h"

#include <chrono>
#include <cmath>

#include "simulator/world/parallel.h"
#include "simulator/world/strata.h"
#include "simulator/world/transport.h"

namespace mesorig::world {
namespace {

using btf::BtfHeader;
using btf::SampledBtf;

Status CheckInput(const World& world, const BtfHeader& header,
                  const std::vector<uint8_t>& present, const TruthOptions& options) {
  MESORIG_RETURN_IF_ERROR(btf::CheckHeader(header));
  if (!(header.pitch_mm > 0)) return InvalidArgument("the BTF has no texel pitch in millimetres");
  if (!header.calibrated) return InvalidArgument("the BTF holds relative values, not sr^-1");
  if (!header.cosine_included) return InvalidArgument("the BTF's values lack the light's cosine");
  if (present.size() != header.views.size() * header.lights.size()) {
    return InvalidArgument("{} presence flags for {} views and {} lights", present.size(),
                           header.views.size(), header.lights.size());
  }
  if (!(header.h_ref_mm >= world.top_mm())) {
    return InvalidArgument("reference plane at {} mm: sample {} rises to {} mm", header.h_ref_mm,
                           world.surface().name, world.top_mm());
  }
  for (int v = 0; v < header.view_count(); ++v) {
    const bool above = header.views[v].z > 1e-3 &&
                       (header.view_positions_mm.empty() ||
                        header.view_positions_mm[v].z > header.h_ref_mm);
    if (!above) return InvalidArgument("view {} is not above the reference plane", v);
  }
  if (options.strata < 1 || options.strata > 64) {
    return InvalidArgument("{} strata a side, permitted is 1 to 64", options.strata);
  }
  return OkStatus();
}

// Sums over the strata of one row of texels.
struct RowSums {
  explicit RowSums(int width) : sum(3 * static_cast<size_t>(width)), square(sum.size()) {}
  std::vector<double> sum, square;
};

class TruthComputation {
 public:
  TruthComputation(const World& world, const BtfHeader& header, int strata)
      : world_(world), header_(header), strata_(strata) {}

  // Row j of every present image of view v. Returns the sum of squared standard errors.
  double Row(int v, int j, SampledBtf& out) const {
    HitRow hits;
    for (int i = 0; i < header_.width; ++i) TraceTexel(v, i, j, hits);
    double squared_error = 0;
    for (int l = 0; l < header_.light_count(); ++l) {
      if (out.Present(v, l)) squared_error += Light(v, l, j, hits, out);
    }
    return squared_error;
  }

 private:
  void TraceTexel(int v, int i, int j, HitRow& hits) const {
    const Vec3 centre = header_.TexelCentre(i, j);
    for (int s = 0; s < strata_ * strata_; ++s) {
      const auto [du, dv] = StratumPoint(s, strata_);
      const Vec3 p =
          centre + Vec3{(du - 0.5) * header_.pitch_mm, (dv - 0.5) * header_.pitch_mm, 0};
      const Vec3 view = header_.ViewAt(v, p);
      const auto hit = world_.FirstHit(p, -view);
      if (hit) hits.Add(*hit, view, static_cast<unsigned>(i), -1);
    }
  }

  double Light(int v, int l, int j, const HitRow& hits, SampledBtf& out) const {
    const bool near = !header_.light_positions_mm.empty();
    const world::Light light{near ? header_.light_positions_mm[l] : header_.lights[l], !near};
    const double floor = near ? header_.h_ref_mm : 0;
    RowSums sums(header_.width);
    Response response;
    if (light.position_mm.z > floor) {  // below it, the turntable hides the lamp
      for (const HitBlock& block : hits.blocks()) {
        Illuminate(world_, block, light, 3, response);
        for (int k = 0; k < block.count; ++k) {
          for (size_t c = 0; c < 3; ++c) {
            const double value = response.value[c][k];
            sums.sum[3 * block.target[k] + c] += value;
            sums.square[3 * block.target[k] + c] += value * value;
          }
        }
      }
    }
    return Store(v, l, j, sums, out);
  }

  double Store(int v, int l, int j, const RowSums& sums, SampledBtf& out) const {
    const auto width = static_cast<size_t>(header_.width);
    const std::span<float> row =
        out.MutableImage(v, l).subspan(3 * width * static_cast<size_t>(j), 3 * width);
    const double n = strata_ * strata_;
    double squared_error = 0;
    for (size_t i = 0; i < row.size(); ++i) {
      double reference = 1;  // d_ref^2: E of a plane that faces the lamp at the texel is I / d_ref^2
      if (!header_.light_positions_mm.empty()) {
        const Vec3 d = header_.light_positions_mm[l] -
                       header_.TexelCentre(static_cast<int>(i / 3), j);
        reference = Dot(d, d);
      }
      const double mean = sums.sum[i] / n;
      row[i] = static_cast<float>(reference * mean);
      if (n > 1) {
        const double variance = std::max(0.0, sums.square[i] / n - mean * mean) * n / (n - 1);
        squared_error += reference * reference * variance / n;
      }
    }
    return squared_error;
  }

  const World& world_;
  const BtfHeader& header_;
  const int strata_;
};

}  // namespace

StatusOr<Truth> ComputeTruth(const World& world, const BtfHeader& header,
                             const std::vector<uint8_t>& present, const TruthOptions& options) {
  MESORIG_RETURN_IF_ERROR(CheckInput(world, header, present, options));
  const auto start = std::chrono::steady_clock::now();
  BtfHeader out_header = header;
  if (options.nominal) {
    out_header.view_positions_mm.clear();
    out_header.light_positions_mm.clear();
  }
  Truth truth;
  truth.btf = SampledBtf(out_header);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      truth.btf.SetPresent(v, l, present[truth.btf.PairIndex(v, l)] != 0);
    }
  }
  const TruthComputation computation(world, out_header, options.strata);
  double squared_error = 0;
  for (int v = 0; v < header.view_count(); ++v) {
    std::vector<double> rows(static_cast<size_t>(header.height));
    ParallelFor(header.height, options.threads,
                [&](int j) { rows[j] = computation.Row(v, j, truth.btf); });
    for (double row : rows) squared_error += row;
    if (options.progress) options.progress((v + 1.0) / header.view_count());
  }
  const double values =
      static_cast<double>(truth.btf.present_count()) * static_cast<double>(truth.btf.image_size());
  if (options.strata > 1 && values > 0) truth.standard_error = std::sqrt(squared_error / values);
  truth.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return truth;
}

}  // namespace mesorig::world
