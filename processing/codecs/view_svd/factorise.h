#pragma once
// Internal to the encoder of view-svd: the factorisation, on Gram matrices alone.

#include <Eigen/Dense>
#include <vector>

namespace mesorig::codecs::view_svd {

// The lights that were seen by the same views, and what their rows say: gram = sum over those lights
// of M_l^T M_l, restricted to `views` (both in that order).
struct LightGroup {
  std::vector<int> views;
  std::vector<int> lights;
  Eigen::MatrixXd gram;
};

// E (views x terms), orthonormal columns in falling order of energy.
//
// Everything present: the right singular vectors of M, as eigenvectors of its Gram matrix. Squaring
// the condition number costs nothing here: the eigen-textures are projections G = M E, not divided
// by singular values, and E is orthonormal whatever the Gram matrix resolves. With all terms
// M E E^T = M to rounding; below rank, only directions 1e-8 times weaker than the first can be mixed
// up.
//
// Pairs absent: they have weight zero, in the fit of G as of E. The rows of one light miss the same
// views, so that the best G for a given E is G_l = M_l A_l with A_l of OnPresent below, and the
// normal equations of E need nothing but the Gram matrices (variable projection, alternating least
// squares; from a pairwise-complete Gram matrix, until the residual stands still).
Eigen::MatrixXd Factorise(const std::vector<LightGroup>& groups, int views, int terms);

// A with G_l = M_l A: least squares over the views that are present (minimum norm where they are
// fewer than the terms). views.size() x terms.
Eigen::MatrixXd OnPresent(const Eigen::MatrixXd& e, const std::vector<int>& views);

}  // namespace mesorig::codecs::view_svd
