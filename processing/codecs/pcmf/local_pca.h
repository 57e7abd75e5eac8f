#pragma once
// Clusters of points that affine subspaces of a few dimensions describe well: local PCA by iteration
// (Kambhatla and Leen 1997, "Dimension reduction by local PCA", VQPCA with reconstruction distance).

#include <cstdint>
#include <vector>

#include "processing/codecs/algebra/matrix.h"

namespace mesorig::codecs::pcmf {

struct LocalPcaOptions {
  int clusters = 32;
  int terms = 8;
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
StatusOr<LocalPcaResult> ClusterByLocalPca(const algebra::MatrixF& points,
                                           const std::vector<float>& weights,
                                           const LocalPcaOptions& options);

}  // namespace mesorig::codecs::pcmf
