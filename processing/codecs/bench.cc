#include "processing/codecs/bench.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <random>

namespace mesorig::codecs {
namespace {

constexpr double kLeastSeconds = 0.1;  // of every timing of decoding
constexpr size_t kAccesses = 4096;     // at random, between two looks at the clock

using Clock = std::chrono::steady_clock;
double Since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// VmHWM or VmRSS of this process, bytes; -1 where the kernel does not tell.
int64_t MemoryOf(std::string_view key) {
  std::ifstream status("/proc/self/status");
  std::string word;
  int64_t kilobytes = 0;
  while (status >> word) {
    if (word == key && status >> kilobytes) return kilobytes * 1024;
  }
  return -1;
}

// From now on VmHWM counts anew. False where the kernel does not let us.
bool RestartPeak() {
  ::malloc_trim(0);
  std::ofstream refs("/proc/self/clear_refs");
  refs << "5" << std::flush;
  return refs.good();
}

double ImageRate(const EncodedBtf& encoded, const btf::SampledBtf& btf) {
  const btf::BtfHeader& h = btf.header();
  std::vector<float> image(btf.image_size());
  double samples = 0;
  const auto start = Clock::now();
  while (Since(start) < kLeastSeconds) {
    for (int v = 0; v < h.view_count() && Since(start) < kLeastSeconds; ++v) {
      for (int l = 0; l < h.light_count(); ++l) {
        if (!btf.Present(v, l)) continue;
        encoded.DecodeImage(v, l, image);
        samples += static_cast<double>(h.texel_count());
      }
    }
  }
  return samples / Since(start);
}

double AccessRate(const EncodedBtf& encoded, const btf::BtfHeader& h) {
  struct Access {
    int x, y;
    Vec3 v, l;
  };
  std::mt19937 random(1);
  const auto uniform = [&] { return static_cast<double>(random()) / 4294967296.0; };
  const auto direction = [&] {
    const double z = 0.2 + 0.8 * uniform(), r = std::sqrt(1 - z * z), phi = 2 * kPi * uniform();
    return Vec3{r * std::cos(phi), r * std::sin(phi), z};
  };
  std::vector<Access> accesses(kAccesses);
  for (Access& a : accesses) {
    a = {static_cast<int>(uniform() * h.width), static_cast<int>(uniform() * h.height),
         direction(), direction()};
  }
  double samples = 0;
  volatile float sum = 0;  // so that nothing is optimised away
  const auto start = Clock::now();
  do {
    float part = 0;
    for (const Access& a : accesses) part += encoded.Evaluate(a.x, a.y, a.v, a.l)[1];
    sum = sum + part;
    samples += static_cast<double>(kAccesses);
  } while (Since(start) < kLeastSeconds);
  return samples / Since(start);
}

}  // namespace

PeakMemory::PeakMemory() : restarted_(RestartPeak()), before_(MemoryOf("VmRSS:")) {}

int64_t PeakMemory::Bytes() const {
  const int64_t after = MemoryOf("VmHWM:");
  return restarted_ && before_ >= 0 && after >= 0 ? std::max<int64_t>(after - before_, 0) : -1;
}

std::vector<BenchPoint> Sweep(const Encoder& encoder, const btf::SampledBtf& btf, int most_terms) {
  const std::string name(encoder.name());
  const int most = std::min(encoder.max_terms(btf), most_terms);
  if (most < 1) return {{&encoder, {}, name, ""}};
  std::vector<BenchPoint> points;
  const bool chooses = (encoder.options() & kQuantisation) != 0;
  for (const Quantisation q : {Quantisation::kHalf, Quantisation::kByte}) {
    if (q == Quantisation::kByte && !chooses) continue;
    for (int terms = 1; terms <= most; terms *= 2) {
      BenchPoint point{&encoder, {}, name, fmt::format("{}", terms)};
      point.options.terms = terms;
      if (chooses) point.options.quantisation = q;
      if (q == Quantisation::kByte) point.series += ", 8 bit";
      points.push_back(std::move(point));
    }
  }
  return points;
}

StatusOr<BenchResult> Measure(const BenchPoint& point, const btf::SampledBtf& btf) {
  BenchResult result;
  const PeakMemory peak;
  const auto start = Clock::now();
  MESORIG_ASSIGN_OR_RETURN(result.encoded, EncodeBtf(*point.encoder, btf, point.options));
  result.encode_s = Since(start);
  result.peak_bytes = peak.Bytes();
  MESORIG_ASSIGN_OR_RETURN(result.bytes, FileBytes(*result.encoded));
  result.errors = MeasureDecoded(*result.encoded, btf);
  result.image_samples_per_s = ImageRate(*result.encoded, btf);
  result.access_samples_per_s = AccessRate(*result.encoded, btf.header());
  result.options_json = result.encoded->info().codec_options_json;
  return result;
}

}  // namespace mesorig::codecs
