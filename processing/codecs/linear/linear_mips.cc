#include "processing/codecs/linear/linear_mips.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

namespace mesorig::codecs {
namespace {

constexpr double kRidge = 1e-9;  // of the Gram matrix' mean diagonal: terms that are all zero
constexpr float kLargestLog = 70;

// The normal equations of one basis, factorised (Cholesky).
struct Normal {
  size_t n = 0;
  std::vector<double> lower;  // row by row

  void Solve(std::vector<double>& x) const {
    for (size_t i = 0; i < n; ++i) {
      for (size_t j = 0; j < i; ++j) x[i] -= lower[i * n + j] * x[j];
      x[i] /= lower[i * n + i];
    }
    for (size_t i = n; i-- > 0;) {
      for (size_t j = i + 1; j < n; ++j) x[i] -= lower[j * n + i] * x[j];
      x[i] /= lower[i * n + i];
    }
  }
};

class Fitter {
 public:
  Fitter(const btf::BtfFileInfo& info, const LinearFactors& factors, int family)
      : factors_(factors), stride_(static_cast<size_t>(factors.shape.stride())),
        terms_(static_cast<size_t>(factors.shape.terms)),
        rows_(3 * factors.shape.pairs(info.header)), family_(static_cast<size_t>(family)),
        present_(rows_) {
    const size_t first = factors.shape.per_view ? family_ * info.header.lights.size() : 0;
    for (size_t r = 0; r < rows_; ++r) present_[r] = info.present[first + r / 3] != 0;
  }

  const float* Basis(size_t cluster) const {
    const size_t basis = factors_.shape.per_view ? family_ : cluster;
    return factors_.h.data() + basis * rows_ * stride_;
  }

  // Adds `weight` times what (g, cluster) decodes to.
  void AddDecoded(const float* g, size_t cluster, float weight, std::vector<float>& y) const {
    const float* const h = Basis(cluster);
    for (size_t r = 0; r < rows_; r += 3) {
      if (!present_[r]) continue;
      std::array<float, 3> rgb{};
      for (size_t c = 0; c < 3; ++c) {
        for (size_t k = 0; k < stride_; ++k) rgb[c] += g[k] * h[(r + c) * stride_ + k];
      }
      if (factors_.decorrelated) {
        rgb = FromDecorrelated(rgb, factors_.log_floor);
      } else if (factors_.log_floor > 0) {
        for (float& x : rgb) x = std::exp(std::min(x, kLargestLog)) - factors_.log_floor;
      }
      for (size_t c = 0; c < 3; ++c) y[r + c] += weight * rgb[c];
    }
  }

  // To the domain in which the bases are linear.
  void Linearise(std::vector<float>& y) const {
    if (factors_.decorrelated) {
      for (size_t r = 0; r < rows_; r += 3) {
        const auto luv = ToDecorrelated(y.data() + r, factors_.log_floor);
        std::copy(luv.begin(), luv.end(), y.begin() + static_cast<std::ptrdiff_t>(r));
      }
      return;
    }
    if (factors_.log_floor <= 0) return;
    for (float& x : y) x = std::log(std::max(x, 0.0f) + factors_.log_floor);
  }

  // The weights of `cluster` nearest to y, into g; returns the squared distance, less y's square.
  double Fit(const std::vector<float>& y, size_t cluster, std::vector<float>& g) {
    const Normal& normal = NormalOf(cluster);
    const float* const h = Basis(cluster);
    std::vector<double> right(terms_, 0.0);
    double square = 0;
    for (size_t r = 0; r < rows_; ++r) {
      if (!present_[r]) continue;
      const float mean = factors_.shape.mean ? h[r * stride_ + terms_] : 0.0f;
      const double rest = y[r] - mean;
      square += rest * rest;
      for (size_t k = 0; k < terms_; ++k) right[k] += rest * h[r * stride_ + k];
    }
    std::vector<double> x = right;
    normal.Solve(x);
    for (size_t k = 0; k < terms_; ++k) {
      g[k] = static_cast<float>(x[k]);
      square -= x[k] * right[k];
    }
    return square;
  }

  size_t stride() const { return stride_; }
  size_t rows() const { return rows_; }

 private:
  const Normal& NormalOf(size_t cluster) {
    Normal& normal = normals_[cluster];
    if (normal.n > 0) return normal;
    normal.n = terms_;
    std::vector<double>& a = normal.lower;
    a.assign(terms_ * terms_, 0.0);
    const float* const h = Basis(cluster);
    for (size_t r = 0; r < rows_; ++r) {
      if (!present_[r]) continue;
      for (size_t i = 0; i < terms_; ++i) {
        for (size_t j = 0; j <= i; ++j) {
          a[i * terms_ + j] += static_cast<double>(h[r * stride_ + i]) * h[r * stride_ + j];
        }
      }
    }
    double mean = 0;
    for (size_t i = 0; i < terms_; ++i) mean += a[i * terms_ + i] / static_cast<double>(terms_);
    const double ridge = mean > 0 ? kRidge * mean : 1.0;
    for (size_t i = 0; i < terms_; ++i) {
      for (size_t j = 0; j <= i; ++j) {
        double sum = a[i * terms_ + j] + (i == j ? ridge : 0.0);
        for (size_t k = 0; k < j; ++k) sum -= a[i * terms_ + k] * a[j * terms_ + k];
        a[i * terms_ + j] = i == j ? std::sqrt(std::max(sum, ridge)) : sum / a[j * terms_ + j];
      }
    }
    return normal;
  }

  const LinearFactors& factors_;
  size_t stride_, terms_, rows_, family_;
  std::vector<char> present_;
  std::map<size_t, Normal> normals_;
};

// One level.
struct Level {
  int width = 0, height = 0;
  std::vector<float> g;
  std::vector<float> cluster;
};

Level Coarser(Fitter& fitter, bool mean, size_t terms, const Level& fine) {
  Level coarse{std::max(1, fine.width / 2), std::max(1, fine.height / 2), {}, {}};
  const size_t stride = fitter.stride();
  std::vector<float> y(fitter.rows()), g(stride, 0.0f), best(stride);
  for (int i = 0; i < coarse.width * coarse.height; ++i) {
    std::vector<size_t> below;
    for (int dy = 0; dy < (fine.height > 1 ? 2 : 1); ++dy) {
      for (int dx = 0; dx < (fine.width > 1 ? 2 : 1); ++dx) {
        below.push_back(static_cast<size_t>((i / coarse.width * 2 + dy) * fine.width +
                                            i % coarse.width * 2 + dx));
      }
    }
    std::fill(y.begin(), y.end(), 0.0f);
    std::vector<size_t> candidates;
    for (const size_t t : below) {
      const auto cluster = static_cast<size_t>(fine.cluster[t]);
      fitter.AddDecoded(fine.g.data() + t * stride, cluster,
                        1.0f / static_cast<float>(below.size()), y);
      if (std::count(candidates.begin(), candidates.end(), cluster) == 0) {
        candidates.push_back(cluster);
      }
    }
    fitter.Linearise(y);
    double least = std::numeric_limits<double>::infinity();
    size_t chosen = candidates[0];
    std::fill(best.begin(), best.end(), 0.0f);
    for (const size_t cluster : candidates) {
      const double distance = fitter.Fit(y, cluster, g);
      // Not finite: bases that no encoder makes, whose weights leave float.
      const bool finite = std::isfinite(distance) &&
                          std::all_of(g.begin(), g.end(), [](float x) { return std::isfinite(x); });
      if (finite && distance < least) least = distance, chosen = cluster, best = g;
    }
    if (mean) best[terms] = 1;
    coarse.g.insert(coarse.g.end(), best.begin(), best.end());
    coarse.cluster.push_back(static_cast<float>(chosen));
  }
  return coarse;
}

}  // namespace

MipFactors FitMips(const btf::BtfFileInfo& info, const LinearFactors& factors, int family) {
  const btf::BtfHeader& h = info.header;
  const size_t stride = static_cast<size_t>(factors.shape.stride()), texels = h.texel_count();
  Fitter fitter(info, factors, family);
  const auto first = factors.g.begin() +
                     static_cast<std::ptrdiff_t>(static_cast<size_t>(family) * texels * stride);
  Level level{h.width, h.height, {first, first + static_cast<std::ptrdiff_t>(texels * stride)}, {}};
  level.cluster.assign(texels, 0.0f);
  std::copy(factors.cluster.begin(), factors.cluster.end(), level.cluster.begin());
  MipFactors mips;
  while (level.width > 1 || level.height > 1) {
    level = Coarser(fitter, factors.shape.mean, static_cast<size_t>(factors.shape.terms), level);
    mips.g.insert(mips.g.end(), level.g.begin(), level.g.end());
    mips.cluster.insert(mips.cluster.end(), level.cluster.begin(), level.cluster.end());
  }
  return mips;
}

}  // namespace mesorig::codecs
