#include "processing/codecs/algebra/local_pca.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

namespace mesorig::codecs::algebra {
namespace {

constexpr int kMeansRounds = 6;
constexpr double kWorthACluster = 1e-6;  // of the energy of all points
constexpr size_t kSeedPoints = 4;        // per term: what a cluster that died starts from

// An affine subspace. `basis` has no columns during k-means.
struct Subspace {
  std::vector<float> mean;
  MatrixF basis;
};

class LocalPca {
 public:
  LocalPca(const MatrixF& points, const std::vector<float>& weights, const LocalPcaOptions& options)
      : points_(points), weights_(weights), options_(options),
        subspaces_(static_cast<size_t>(std::min<int64_t>(options.clusters, points.rows))),
        distance_(static_cast<size_t>(points.rows)) {
    result_.cluster.assign(static_cast<size_t>(points.rows), 0);
    for (int64_t i = 0; i < points.rows; ++i) energy_ += weights_[At(i)] * Square(i, nullptr);
  }

  StatusOr<LocalPcaResult> Run() {
    Scatter();
    for (int round = 0; round < kMeansRounds; ++round) {
      Assign();
      MESORIG_RETURN_IF_ERROR(Refit(0));
    }
    Assign();
    double before = -1;
    for (; result_.rounds < options_.max_rounds; ++result_.rounds) {
      MESORIG_RETURN_IF_ERROR(Refit(options_.terms));
      const double now = Assign();
      // A cluster that starts again may cost a little before it pays.
      if (const bool again = Reseed(); again) {
        before = -1;
        continue;
      }
      result_.errors.push_back(now);
      if (before >= 0 && before - now <= options_.stop * before) break;
      before = now;
    }
    DropEmpty();
    return std::move(result_);
  }

 private:
  static size_t At(int64_t i) { return static_cast<size_t>(i); }

  // ||p - mean||^2
  double Square(int64_t i, const std::vector<float>* mean) const {
    double sum = 0;
    for (int64_t j = 0; j < points_.cols; ++j) {
      const double x = points_(i, j) - (mean != nullptr ? (*mean)[At(j)] : 0.0f);
      sum += x * x;
    }
    return sum;
  }

  // k-means++: the next centre is drawn with a probability that grows with the squared distance.
  void Scatter() {
    std::mt19937_64 random(options_.seed);
    std::vector<double> nearest(At(points_.rows), 1.0);
    for (size_t k = 0; k < subspaces_.size(); ++k) {
      double total = 0;
      for (size_t i = 0; i < nearest.size(); ++i) total += weights_[i] * nearest[i];
      double left = total * static_cast<double>(random() >> 11) * 0x1p-53;
      size_t chosen = 0;
      while (chosen + 1 < nearest.size() && (left -= weights_[chosen] * nearest[chosen]) > 0) {
        ++chosen;
      }
      Subspace& s = subspaces_[k];
      s.mean.resize(At(points_.cols));
      for (int64_t j = 0; j < points_.cols; ++j) {
        s.mean[At(j)] = points_(static_cast<int64_t>(chosen), j);
      }
      for (int64_t i = 0; i < points_.rows; ++i) {
        const double d = Square(i, &s.mean);
        nearest[At(i)] = k == 0 ? d : std::min(nearest[At(i)], d);
      }
    }
  }

  // Each point to its nearest subspace; ties go to the first. Returns the weighted error.
  double Assign() {
    std::fill(distance_.begin(), distance_.end(), std::numeric_limits<double>::infinity());
    for (size_t k = 0; k < subspaces_.size(); ++k) {
      const Subspace& s = subspaces_[k];
      if (s.mean.empty()) continue;
      MatrixF rest = points_;
      for (int64_t j = 0; j < rest.cols; ++j) {
        for (int64_t i = 0; i < rest.rows; ++i) rest(i, j) -= s.mean[At(j)];
      }
      // What the basis leaves, itself: as a difference of squares it would vanish in their rounding.
      if (s.basis.cols > 0) {
        MatrixF inside = Multiply(rest, false, s.basis, false);
        for (float& x : inside.values) x = -x;
        MultiplyInto(inside, false, s.basis, true, 1.0f, rest.values.data(), rest.rows);
      }
      std::vector<double> d(distance_.size(), 0.0);
      for (int64_t j = 0; j < rest.cols; ++j) {
        const float* const column = rest.Column(j);
        for (size_t i = 0; i < d.size(); ++i) d[i] += static_cast<double>(column[i]) * column[i];
      }
      for (size_t i = 0; i < d.size(); ++i) {
        if (d[i] < distance_[i]) distance_[i] = d[i], result_.cluster[i] = static_cast<int>(k);
      }
    }
    double error = 0;
    for (size_t i = 0; i < distance_.size(); ++i) error += weights_[i] * distance_[i];
    return error;
  }

  std::vector<int64_t> Members(size_t k) const {
    std::vector<int64_t> members;
    for (size_t i = 0; i < result_.cluster.size(); ++i) {
      if (result_.cluster[i] == static_cast<int>(k)) members.push_back(static_cast<int64_t>(i));
    }
    return members;
  }

  // Mean and leading eigenvectors of each cluster's points.
  Status Refit(int terms) {
    for (size_t k = 0; k < subspaces_.size(); ++k) {
      const std::vector<int64_t> members = Members(k);
      subspaces_[k] = {};
      if (!members.empty()) MESORIG_RETURN_IF_ERROR(Fit(members, terms, subspaces_[k]));
    }
    return OkStatus();
  }

  Status Fit(const std::vector<int64_t>& members, int terms, Subspace& s) const {
    const int64_t dims = points_.cols;
    std::vector<double> mean(At(dims), 0.0);
    double total = 0;
    for (const int64_t i : members) total += weights_[At(i)];
    for (int64_t j = 0; j < dims; ++j) {
      for (const int64_t i : members) mean[At(j)] += weights_[At(i)] * points_(i, j) / total;
    }
    s.mean.assign(mean.begin(), mean.end());
    s.basis = MatrixF(dims, std::min<int64_t>(terms, dims));
    if (s.basis.cols == 0) return OkStatus();
    MatrixF centred(static_cast<int64_t>(members.size()), dims);
    for (int64_t j = 0; j < dims; ++j) {
      for (int64_t r = 0; r < centred.rows; ++r) {
        const int64_t i = members[At(r)];
        centred(r, j) = std::sqrt(weights_[At(i)]) * (points_(i, j) - s.mean[At(j)]);
      }
    }
    MatrixD covariance(dims, dims);
    AddGram(centred, covariance);
    std::vector<double> values;
    MESORIG_RETURN_IF_ERROR(SymmetricEigen(covariance, values));
    for (int64_t j = 0; j < s.basis.cols; ++j) {
      for (int64_t i = 0; i < dims; ++i) s.basis(i, j) = static_cast<float>(covariance(i, j));
    }
    return OkStatus();
  }

  // Gives every empty cluster the worst points of the others. False if none was empty or worth it.
  bool Reseed() {
    std::vector<size_t> sizes(subspaces_.size(), 0);
    for (const int k : result_.cluster) ++sizes[static_cast<size_t>(k)];
    std::vector<size_t> order(distance_.size());
    std::iota(order.begin(), order.end(), size_t{0});
    bool any = false;
    for (size_t k = 0; k < sizes.size(); ++k) {
      if (sizes[k] > 0 || result_.reseeded >= 4 * static_cast<int>(sizes.size())) continue;
      const size_t count = std::min(order.size(), kSeedPoints * At(options_.terms + 1));
      std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                        [this](size_t a, size_t b) {
                          return weights_[a] * distance_[a] > weights_[b] * distance_[b];
                        });
      double worth = 0;
      for (size_t i = 0; i < count; ++i) worth += weights_[order[i]] * distance_[order[i]];
      if (worth <= kWorthACluster * energy_) break;
      for (size_t i = 0; i < count; ++i) {
        result_.cluster[order[i]] = static_cast<int>(k);
        distance_[order[i]] = 0;  // not for the next empty cluster
      }
      ++result_.reseeded;
      any = true;
    }
    return any;
  }

  void DropEmpty() {
    std::vector<int> name(subspaces_.size(), -1);
    for (int& k : result_.cluster) {
      int& n = name[static_cast<size_t>(k)];
      if (n < 0) n = result_.clusters++;
      k = n;
    }
  }

  const MatrixF& points_;
  const std::vector<float>& weights_;
  const LocalPcaOptions& options_;
  std::vector<Subspace> subspaces_;
  std::vector<double> distance_;
  double energy_ = 0;
  LocalPcaResult result_;
};

}  // namespace

StatusOr<LocalPcaResult> ClusterByLocalPca(const MatrixF& points, const std::vector<float>& weights,
                                           const LocalPcaOptions& options) {
  if (points.rows < 1 || points.cols < 1 || weights.size() != static_cast<size_t>(points.rows)) {
    return InvalidArgument("{} points of {} dimensions with {} weights", points.rows, points.cols,
                           weights.size());
  }
  if (options.clusters < 1 || options.terms < 0) {
    return InvalidArgument("{} clusters of {} terms, at least 1 of 0 are permitted",
                           options.clusters, options.terms);
  }
  return LocalPca(points, weights, options).Run();
}

StatusOr<LocalPcaResult> ClusterRows(const RowSource& rows, const std::vector<float>& row_weights,
                                     const SvdOptions& svd_options, const LocalPcaOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(TruncatedSvd svd, DecomposeTruncated(rows, svd_options));
  MatrixF& points = svd.u;
  std::vector<float> squares(row_weights.size());
  for (int64_t i = 0; i < points.rows; ++i) {
    const float weight = row_weights[static_cast<size_t>(i)];
    squares[static_cast<size_t>(i)] = weight * weight;
    for (int64_t j = 0; j < points.cols; ++j) {
      points(i, j) *= static_cast<float>(svd.sigma[static_cast<size_t>(j)] / weight);
    }
  }
  return ClusterByLocalPca(points, squares, options);
}

}  // namespace mesorig::codecs::algebra
