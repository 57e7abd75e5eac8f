#include "processing/mesostructure/stripe.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "processing/mesostructure/gaussian_peak.h"
#include "protocol/base/check.h"

namespace mesorig::mesostructure {
namespace {

constexpr double kMadToSigma = 1.4826;  // of a normal distribution
constexpr double kLeastRelativeNoise =
    1e-4;                        // of the largest value: quantised darkness has no noise
constexpr double kWindow = 3;    // sigmas to both sides that a peak is fitted in
constexpr double kApart = 3.5;   // sigmas between two peaks that are two
constexpr int kPairs = 150;      // (3/4)^150: the chance that no pair is good, half being bad
constexpr double kWidest = 1.5;  // of the stripe's sigma: more scatter is no line
constexpr int kReweightings = 12;
constexpr double kTukey = 4.685;  // 95 % efficiency (Huber, Robust Statistics)

double Median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Sample {
  double x = 0, y = 0;
  bool saturated = false;
};

// One profile at a time; keeps its memory.
class ProfileReader {
 public:
  ProfileReader(const StripeImage& image, Profiles profiles, const StripeOptions& options)
      : image_(image), rows_(profiles == Profiles::kRows), options_(options) {}

  int profile_count() const { return rows_ ? image_.height : image_.width; }

  std::optional<StripeCandidate> Find(int line) {
    Read(line);
    if (samples_.size() < 5) return std::nullopt;
    Measure();
    size_t left = 0, right = 0;
    if (!(highest_ - background_ > options_.least_snr * noise_) || !HalfWidth(left, right)) {
      return std::nullopt;
    }
    const double spacing =
        (samples_[right].x - samples_[left].x + 1) / static_cast<double>(right - left + 1);
    const double middle = 0.5 * (samples_[left].x + samples_[right].x);
    const double fwhm = std::max(samples_[right].x - samples_[left].x, spacing);
    double sigma = options_.sigma_px > 0 ? options_.sigma_px : fwhm / kFwhmPerSigma;
    std::optional<GaussianPeak> peak;
    // Twice, since the first window comes from a rough width.
    for (int pass = 0; pass < 2; ++pass) {
      peak = Fit(peak ? peak->centre : middle, sigma, spacing);
      if (!peak) return std::nullopt;
      sigma = peak->sigma;
    }
    if (std::abs(peak->centre - middle) > fwhm) return std::nullopt;
    return Judge(line, *peak);
  }

 private:
  void Read(int line) {
    samples_.clear();
    const int count = rows_ ? image_.width : image_.height;
    const auto width = static_cast<size_t>(image_.width);
    size_t at = rows_ ? static_cast<size_t>(line) * width : static_cast<size_t>(line);
    for (int k = 0; k < count; ++k, at += rows_ ? 1 : width) {
      const float y = image_.value[at];
      if ((!image_.usable.empty() && image_.usable[at] == 0) || !std::isfinite(y)) continue;
      samples_.push_back({k + 0.5, static_cast<double>(y), y >= image_.saturation});
    }
  }

  void Measure() {
    scratch_.clear();
    highest_ = samples_[0].y, top_ = 0;
    for (size_t k = 0; k < samples_.size(); ++k) {
      scratch_.push_back(samples_[k].y);
      if (samples_[k].y > highest_) highest_ = samples_[k].y, top_ = k;
    }
    background_ = Median(scratch_);
    noise_ = image_.noise;
    if (!(noise_ > 0)) {
      scratch_.clear();
      for (size_t k = 1; k < samples_.size(); ++k) {
        scratch_.push_back(std::abs(samples_[k].y - samples_[k - 1].y));
      }
      noise_ = kMadToSigma / std::sqrt(2.0) * Median(scratch_);
    }
    noise_ = std::max({noise_, kLeastRelativeNoise * std::abs(highest_), 1e-12});
  }

  // First and last sample above half of the peak. False when the profile, or its usable part, ends
  // before the flanks do.
  bool HalfWidth(size_t& left, size_t& right) const {
    const double half = 0.5 * (highest_ + background_);
    left = right = top_;
    while (left > 0 && samples_[left].y > half) --left;
    while (right + 1 < samples_.size() && samples_[right].y > half) ++right;
    if (samples_[left].y > half || samples_[right].y > half) return false;
    for (size_t k = left; k < right; ++k) {
      if (samples_[k + 1].x - samples_[k].x > 4) return false;
    }
    return true;
  }

  std::optional<GaussianPeak> Fit(double centre, double sigma, double spacing) {
    const double reach = std::max(kWindow * sigma, 2.5 * spacing);
    peak_samples_.clear();
    for (const Sample& s : samples_) {
      if (std::abs(s.x - centre) > reach || s.saturated) continue;
      peak_samples_.push_back({s.x, s.y, VarianceOf(s.y)});
    }
    const double spread = options_.sigma_px > 0 ? 0.2 : 1.0;
    const PeakPrior prior{centre,      highest_ - background_,
                          sigma,       spread,
                          background_, 0.05 * (highest_ - background_) + noise_};
    return FitGaussianPeak(peak_samples_, prior);
  }

  double VarianceOf(double y) const {
    return noise_ * noise_ + image_.shot * std::max(y - background_, 0.0);
  }

  std::optional<StripeCandidate> Judge(int line, const GaussianPeak& peak) const {
    double second = background_;
    for (const Sample& s : samples_) {
      if (std::abs(s.x - peak.centre) > kApart * peak.sigma + 1) second = std::max(second, s.y);
    }
    const double height = highest_ - background_;
    const bool seen = second - background_ > options_.least_snr * noise_;
    if (seen && second - background_ > options_.second_peak * height) return std::nullopt;
    StripeCandidate candidate;
    candidate.along = line + 0.5, candidate.across = peak.centre;
    candidate.variance = peak.centre_variance * std::max(peak.chi_square, 1.0);
    if (seen && second - background_ > 0.5 * options_.second_peak * height) candidate.variance *= 3;
    candidate.sigma_px = peak.sigma, candidate.peak = peak.amplitude;
    return candidate;
  }

  const StripeImage& image_;
  const bool rows_;
  const StripeOptions& options_;
  std::vector<Sample> samples_;
  std::vector<double> scratch_;
  std::vector<PeakSample> peak_samples_;
  double highest_ = 0, background_ = 0, noise_ = 0;
  size_t top_ = 0;
};

struct Line {
  double centre = 0, position = 0, slope = 0;
  double Residual(const StripeCandidate& c) const {
    return c.across - position - slope * (c.along - centre);
  }
};

double MedianSquare(const Line& line, std::span<const StripeCandidate> candidates,
                    std::vector<double>& scratch) {
  scratch.clear();
  for (const StripeCandidate& c : candidates) {
    const double r = line.Residual(c);
    scratch.push_back(r * r);
  }
  return Median(scratch);
}

// Rousseeuw 1984: the line whose median squared residual is least.
Line LeastMedianLine(std::span<const StripeCandidate> candidates, double& median_square) {
  std::mt19937 random(1);
  std::vector<double> scratch;
  Line best;
  median_square = std::numeric_limits<double>::infinity();
  for (int pair = 0; pair < kPairs; ++pair) {
    const StripeCandidate& a = candidates[random() % candidates.size()];
    const StripeCandidate& b = candidates[random() % candidates.size()];
    if (std::abs(a.along - b.along) < 0.5) continue;
    const Line line{a.along, a.across, (b.across - a.across) / (b.along - a.along)};
    const double median = MedianSquare(line, candidates, scratch);
    if (median < median_square) median_square = median, best = line;
  }
  return best;
}

struct Sums {
  double weight = 0, along = 0, across = 0, along_along = 0, along_across = 0, chi_square = 0;
  int inliers = 0;
};

// One reweighted least-squares step. False when the weights no longer determine a line.
bool Reweigh(std::span<const StripeCandidate> candidates, double extra_variance, double scale,
             Line& line, Sums& sums) {
  sums = {};
  double mean = 0;
  std::vector<double> weights(candidates.size());
  for (size_t k = 0; k < candidates.size(); ++k) {
    const double variance = candidates[k].variance + extra_variance;
    const double z = line.Residual(candidates[k]) / (kTukey * scale * std::sqrt(variance));
    if (!(std::abs(z) < 1)) continue;
    weights[k] = (1 - z * z) * (1 - z * z) / variance;
    sums.weight += weights[k], mean += weights[k] * candidates[k].along;
    ++sums.inliers;
  }
  if (!(sums.weight > 0)) return false;
  mean /= sums.weight;
  for (size_t k = 0; k < candidates.size(); ++k) {
    const double x = candidates[k].along - mean, y = candidates[k].across;
    sums.across += weights[k] * y;
    sums.along_along += weights[k] * x * x, sums.along_across += weights[k] * x * y;
  }
  if (!(sums.along_along > 1e-9 * sums.weight)) return false;
  line = {mean, sums.across / sums.weight, sums.along_across / sums.along_along};
  for (size_t k = 0; k < candidates.size(); ++k) {
    const double r = line.Residual(candidates[k]);
    sums.chi_square += weights[k] * r * r;
  }
  return true;
}

}  // namespace

std::vector<StripeCandidate> FindStripe(const StripeImage& image, Profiles profiles,
                                        const StripeOptions& options) {
  const size_t pixels = static_cast<size_t>(image.width) * static_cast<size_t>(image.height);
  MESORIG_CHECK(image.value.size() == pixels);
  MESORIG_CHECK(image.usable.empty() || image.usable.size() == pixels);
  ProfileReader reader(image, profiles, options);
  std::vector<StripeCandidate> candidates;
  for (int line = 0; line < reader.profile_count(); ++line) {
    if (const auto candidate = reader.Find(line)) candidates.push_back(*candidate);
  }
  return candidates;
}

Profiles ChooseProfiles(const StripeImage& image, const StripeOptions& options) {
  const auto share = [&](Profiles profiles, int lines) {
    return static_cast<double>(FindStripe(image, profiles, options).size()) / std::max(lines, 1);
  };
  return share(Profiles::kRows, image.height) >= share(Profiles::kColumns, image.width)
             ? Profiles::kRows
             : Profiles::kColumns;
}

StatusOr<StripeLine> FitStripeLine(std::span<const StripeCandidate> candidates, Profiles profiles,
                                   const StripeOptions& options) {
  const auto count = static_cast<double>(candidates.size());
  if (count < std::max(options.least_candidates, 3.0)) {
    return FailedPrecondition("no stripe: it shows in {} profiles, at least {} are needed",
                              candidates.size(), std::max(options.least_candidates, 3.0));
  }
  double median_square = 0;
  Line line = LeastMedianLine(candidates, median_square);
  if (!std::isfinite(median_square)) {
    return FailedPrecondition("no stripe: all of it shows in one profile");
  }
  std::vector<double> variances, widths;
  for (const StripeCandidate& c : candidates) {
    variances.push_back(c.variance), widths.push_back(c.sigma_px);
  }
  const double typical = Median(variances);
  const double deviation = kMadToSigma * (1 + 5 / (count - 2)) * std::sqrt(median_square);
  const double width = Median(widths);
  if (!(deviation <= std::max(kWidest * width, 1.0))) {
    return FailedPrecondition(
        "no stripe: {} profiles scatter by {:.2f} px, the stripe is {:.2f} px wide (standard "
        "deviation)",
        candidates.size(), deviation, width);
  }
  const double extra = std::max(deviation * deviation - typical, 0.0) + 1e-12;
  Sums sums;
  for (int k = 0; k < kReweightings; ++k) {
    if (!Reweigh(candidates, extra, 1.0, line, sums)) {
      return FailedPrecondition("no stripe: its candidates do not lie on a line");
    }
  }
  if (2 * sums.inliers < static_cast<int>(candidates.size()) ||
      sums.inliers < options.least_candidates) {
    return FailedPrecondition("no stripe: {} of {} profiles agree on a line", sums.inliers,
                              candidates.size());
  }
  const double excess = std::max(1.0, sums.chi_square / std::max(sums.inliers - 2.0, 1.0));
  StripeLine result;
  result.profiles = profiles;
  result.centre = line.centre, result.position = line.position, result.slope = line.slope;
  result.position_variance = excess / sums.weight;
  result.slope_variance = excess / sums.along_along;
  result.residual_px = deviation;
  result.candidates = static_cast<int>(candidates.size()), result.inliers = sums.inliers;
  return result;
}

}  // namespace mesorig::mesostructure
