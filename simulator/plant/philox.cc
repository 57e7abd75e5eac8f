#include "simulator/plant/philox.h"

#include <cmath>
#include <numbers>

namespace mesorig::plant {
namespace {

// log(k!), relative error below 1e-14; std::lgamma writes a global.
double LogFactorial(double k) {
  static constexpr double kSmall[] = {0.0,
                                      0.0,
                                      0.69314718055994531,
                                      1.79175946922805500,
                                      3.17805383034794562,
                                      4.78749174278204599,
                                      6.57925121201010100,
                                      8.52516136106541430,
                                      10.6046029027452502,
                                      12.8018274800814696};
  if (k < 10) return kSmall[static_cast<int>(k)];
  const double x = k + 1, r = 1 / x, r2 = r * r;  // Stirling's series of log gamma(x)
  return (x - 0.5) * std::log(x) - x + 0.91893853320467274 +
         r * (1.0 / 12 - r2 * (1.0 / 360 - r2 * (1.0 / 1260 - r2 / 1680)));
}

int64_t PoissonByInversion(PhiloxStream& random, double mean) {
  const double u = random.Uniform();
  double probability = std::exp(-mean), sum = probability;
  int64_t k = 0;
  while (u >= sum && k < 200) {  // 200: beyond 53 bits at a mean of 10
    ++k;
    probability *= mean / static_cast<double>(k);
    sum += probability;
  }
  return k;
}

// Hoermann 1993, "The transformed rejection method for generating Poisson random variables", PTRS.
int64_t PoissonByRejection(PhiloxStream& random, double mean) {
  const double b = 0.931 + 2.53 * std::sqrt(mean);
  const double a = -0.059 + 0.02483 * b;
  const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
  const double v_r = 0.9277 - 3.6224 / (b - 2);
  const double log_mean = std::log(mean);
  while (true) {
    const double u = random.Uniform() - 0.5, v = 1 - random.Uniform();
    const double us = 0.5 - std::abs(u);
    const double k = std::floor((2 * a / us + b) * u + mean + 0.43);
    if (us >= 0.07 && v <= v_r) return static_cast<int64_t>(k);
    if (!(k >= 0) || (us < 0.013 && v > us)) continue;
    if (std::log(v * inverse_alpha / (a / (us * us) + b)) <=
        k * log_mean - mean - LogFactorial(k)) {
      return static_cast<int64_t>(k);
    }
  }
}

}  // namespace

PhiloxCounter Philox4x32(PhiloxCounter c, PhiloxKey k) {
  for (int round = 0; round < 10; ++round) {
    const uint64_t p0 = uint64_t{0xD2511F53} * c[0];
    const uint64_t p1 = uint64_t{0xCD9E8D57} * c[2];
    c = {static_cast<uint32_t>(p1 >> 32) ^ c[1] ^ k[0], static_cast<uint32_t>(p1),
         static_cast<uint32_t>(p0 >> 32) ^ c[3] ^ k[1], static_cast<uint32_t>(p0)};
    k[0] += 0x9E3779B9;
    k[1] += 0xBB67AE85;
  }
  return c;
}

uint32_t PhiloxStream::Word() {
  if (used_ == 4) {
    block_ = Philox4x32(counter_, key_);
    ++counter_[0];
    used_ = 0;
  }
  return block_[used_++];
}

double PhiloxStream::Uniform() {
  const uint64_t high = Word(), low = Word();
  return static_cast<double>((high << 21) ^ (low >> 11)) * 0x1p-53;
}

double PhiloxStream::Gaussian() {
  const double radius = std::sqrt(-2 * std::log(1 - Uniform()));  // 1 - u is never 0
  return radius * std::cos(2 * std::numbers::pi * Uniform());
}

int64_t PhiloxStream::Poisson(double mean) {
  if (!(mean > 0)) return 0;
  return mean < 10 ? PoissonByInversion(*this, mean) : PoissonByRejection(*this, mean);
}

}  // namespace mesorig::plant
