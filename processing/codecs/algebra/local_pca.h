#pragma once
// Clusters of points that affine subspaces of a few dimensions describe well: local PCA by iteration
// (Kambhatla and Leen 1997, "Dimension reduction by local PCA", VQPCA with reconstruction distance).

#include <cstdint>
#include <vector>

#include "processing/codecs/algebra/truncated_svd.h"

namespace mesorig::codecs::algebra {

struct LocalPcaOptions {
  int clusters = 32;
  int terms = 8;  // 0: k-means
  int max_rounds = 40;
  double stop = 1e-3;  // rounds end when one lowers the error by less than this fraction
  uint64_t seed = 1;
};
struct LocalPcaResult {
  std::vector<int> cluster;  // of each point, 0 to clusters - 1, none of them empty
  int clusters = 0;          // fewer than asked for where no point needs more
  int rounds = 0, reseeded = 0;
  std::vector<double> errors;  // sum of weighted squares after each round, not rising
};

// `points`: a row a point, finite. `weights`: positive, one a point.
// Points go to the cluster with the smallest ||p - m - E E^T (p - m)||; each cluster takes the mean
// and the leading eigenvectors of the covariance of its points. Starts from k-means++ and a few
// rounds of k-means. A cluster that loses its points starts again at the worst points of the others
// while that error is worth a cluster (1e-6 of the total), else it is dropped.
StatusOr<LocalPcaResult> ClusterByLocalPca(const MatrixF& points,
                                           const std::vector<float>& weights,
                                           const LocalPcaOptions& options);

// Clusters of the rows of a matrix, in the coordinates of its leading singular vectors (there a row is
// svd_options.rank numbers). `row_weights`, positive: what each row has been multiplied by; it counts
// by the square of that.
StatusOr<LocalPcaResult> ClusterRows(const RowSource& rows, const std::vector<float>& row_weights,
                                     const SvdOptions& svd_options, const LocalPcaOptions& options);

}  // namespace mesorig::codecs::algebra
