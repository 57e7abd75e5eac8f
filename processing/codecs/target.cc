#include "processing/codecs/target.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>

#include "processing/btf/errors.h"

namespace mesorig::codecs {
namespace {

// Counts of magnitudes, 32 to a factor of two: a percentile to 2 %.
class Percentile {
 public:
  void Add(double magnitude) {
    if (magnitude > 0) {
      const double bin = (std::log2(magnitude) + kOffset) * kBinsPerOctave;
      ++counts_[static_cast<size_t>(std::clamp(bin, 0.0, double{kBins - 1}))];
    } else {
      ++zeros_;
    }
    ++total_;
  }
  // The magnitude that this fraction of all does not exceed.
  double At(double fraction) const {
    double left = fraction * static_cast<double>(total_) - static_cast<double>(zeros_);
    if (left <= 0) return 0;
    for (size_t i = 0; i < kBins; ++i) {
      left -= static_cast<double>(counts_[i]);
      if (left <= 0) return std::exp2((static_cast<double>(i) + 0.5) / kBinsPerOctave - kOffset);
    }
    return 0;
  }

 private:
  static constexpr int kBinsPerOctave = 32, kOffset = 60, kBins = 120 * kBinsPerOctave;
  std::array<uint64_t, kBins> counts_{};
  uint64_t zeros_ = 0, total_ = 0;
};

}  // namespace

DecodedErrors MeasureDecoded(const EncodedBtf& encoded, const btf::SampledBtf& btf) {
  const btf::BtfHeader& h = btf.header();
  std::vector<float> image(btf.image_size());
  auto percentile = std::make_unique<Percentile>();
  double difference = 0, reference = 0, magnitude = 0, negative = 0;
  uint64_t samples = 0;
  const bool clamp = encoded.info().clamp_negative;
  DecodedErrors e;
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      encoded.before_clamping().DecodeImage(v, l, image);
      const auto truth = btf.Image(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        if (!h.InMask(i / 3)) continue;
        const double a = clamp ? std::max(image[i], 0.0f) : image[i], b = truth[i];
        const double d = std::abs(a - b);
        difference += d * d, reference += b * b, magnitude += std::abs(b);
        negative += std::max(0.0f, -image[i]);
        e.max_abs = std::max(e.max_abs, d);
        percentile->Add(d);
        ++samples;
      }
    }
  }
  if (samples == 0) return e;
  e.rmse = std::sqrt(difference / static_cast<double>(samples));
  e.rel_error = reference > 0 ? std::sqrt(difference / reference) : (difference > 0 ? 1 : 0);
  e.psnr_db = btf::PsnrDb(btf::PsnrPeak(h), e.rmse);
  e.p99_abs = percentile->At(0.99);
  e.clamped_mass = magnitude > 0 ? negative / magnitude : 0;
  return e;
}

StatusOr<uint64_t> FileBytes(const EncodedBtf& encoded) {
  std::error_code error;
  std::string folder = (std::filesystem::temp_directory_path(error) / "mesorig-size-XXXXXX").string();
  if (error || ::mkdtemp(folder.data()) == nullptr) {
    return Unavailable("cannot create {}: {}", folder, std::strerror(errno));
  }
  const std::filesystem::path file = std::filesystem::path(folder) / "c.btf.exr";
  const Status written = WriteEncodedBtf(encoded, file);
  const uint64_t bytes = written.ok() ? std::filesystem::file_size(file, error) : 0;
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  if (!written.ok()) return written;
  if (error) return Unavailable("{}: {}", file.string(), error.message());
  return bytes;
}

StatusOr<std::unique_ptr<EncodedBtf>> EncodeToTarget(const Encoder& encoder,
                                                     const btf::SampledBtf& btf,
                                                     EncodeOptions options, const Target& target) {
  if ((target.error > 0) == (target.bytes > 0)) {
    return InvalidArgument("a target is an error above 0 or a size above 0, not both");
  }
  const int most = encoder.max_terms(btf);
  if (most < 1) return InvalidArgument("codec {} has no terms to choose", encoder.name());
  const bool by_error = target.error > 0;
  std::unique_ptr<EncodedBtf> best;
  double reached = 0;  // error or bytes of the last try
  // Whether so many terms are enough (error), or are affordable (bytes); keeps what should be kept.
  const auto fits = [&](int terms) -> StatusOr<bool> {
    options.terms = terms;
    MESORIG_ASSIGN_OR_RETURN(auto encoded, EncodeBtf(encoder, btf, options));
    if (by_error) {
      reached = MeasureDecoded(*encoded, btf).rel_error;
      if (reached <= target.error) best = std::move(encoded);
      return reached <= target.error;
    }
    MESORIG_ASSIGN_OR_RETURN(const uint64_t bytes, FileBytes(*encoded));
    reached = static_cast<double>(bytes);
    if (bytes <= target.bytes) best = std::move(encoded);
    return bytes <= target.bytes;
  };
  // Gallops to the first number of terms where the answer changes, then bisects.
  int low = 0, high = 1;  // the answer differs between low and high
  for (;; high = std::min(2 * high, most)) {
    MESORIG_ASSIGN_OR_RETURN(const bool ok, fits(high));
    if (ok == by_error) break;
    low = high;
    if (high == most) break;
  }
  if (low == most) {
    if (!by_error) return best;  // all terms are affordable
    return InvalidArgument("codec {} reaches a relative error of {:.3g} with all {} terms, {:.3g} is asked for",
                           encoder.name(), reached, most, target.error);
  }
  if (!by_error && low == 0) {
    return InvalidArgument("codec {} needs {} bytes for one term, at most {} are asked for",
                           encoder.name(), reached, target.bytes);
  }
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    MESORIG_ASSIGN_OR_RETURN(const bool ok, fits(middle));
    (ok == by_error ? high : low) = middle;
  }
  return best;
}

}  // namespace mesorig::codecs
