#pragma once
// Internal to the encoder of rf-ptm.

#include <Eigen/Dense>
#include <vector>

#include "protocol/base/geometry.h"

namespace mesorig::codecs::rf_ptm {

inline constexpr double kDefaultRegularisation = 0.01;

// The linear map from the values of one texel under `lights` to its six coefficients (6 x lights):
// weighted least squares with a Tikhonov term.
//
// An unregularised biquadratic fit to eleven lights within 39 degrees of the view predicts a twelfth
// 2-4 dB worse than Lambert's law does. Lambert's law is linear in lx, ly, lz, and over a cone lz is
// nearly c0 + c1 (lx^2 + ly^2): a three-dimensional subspace of the polynomials. What lies in it is
// (all but) free; the curvatures beyond it, lx^2, ly^2 and lx ly, are penalised with
// `regularisation` times their square, where the weights average one a light: the prior weighs as
// much as `regularisation` lights, whatever their number. A tiny term on the rest keeps one light, or
// collinear ones, at the least-norm fit.
//   weights: of the lights, > 0, mean 1.
Eigen::MatrixXd FitOperator(const std::vector<Vec3>& lights, const Eigen::VectorXd& weights,
                            double regularisation);

// How far each light can be trusted, mean 1, from the data alone: the inverse of the variance of
// what a Lambert fit leaves of it (corrected for the fit's own leverage), iterated. Photographs whose
// lamp stood elsewhere or shone less than their light vector says spoil the fit of all others; they
// are found by not agreeing with them. All 1 for fewer than five lights.
//   gram: lights x lights, mean over texels of products of values.
Eigen::VectorXd LightWeights(const std::vector<Vec3>& lights, const Eigen::MatrixXd& gram);

}  // namespace mesorig::codecs::rf_ptm
