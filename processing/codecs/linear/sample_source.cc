#include "processing/codecs/linear/sample_source.h"

namespace mesorig::codecs {

std::vector<size_t> SampleSource::Pairs() const {
  std::vector<size_t> pairs;
  for (size_t pair = 0; pair < present().size(); ++pair) {
    if (present()[pair] != 0) pairs.push_back(pair);
  }
  return pairs;
}

MemorySource::MemorySource(const btf::SampledBtf& btf) : btf_(btf) {
  for (int v = 0; v < btf.header().view_count(); ++v) {
    for (int l = 0; l < btf.header().light_count(); ++l) present_.push_back(btf.Present(v, l) ? 1 : 0);
  }
}

Status MemorySource::Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                             float* out) const {
  const auto n = static_cast<size_t>(count);
  const size_t lights = header().lights.size();
  for (const size_t pair : pairs) {
    const float* const image =
        btf_.Image(static_cast<int>(pair / lights), static_cast<int>(pair % lights)).data() +
        3 * first;
    for (size_t i = 0; i < n; ++i) {
      for (size_t c = 0; c < 3; ++c) out[c * n + i] = image[3 * i + c];
    }
    out += 3 * n;
  }
  return OkStatus();
}

Status FileSource::Columns(int64_t first, int64_t count, std::span<const size_t> pairs,
                           float* out) const {
  const int64_t width = header().width;
  if (first % width != 0 || count % width != 0) {
    return InvalidArgument("texels {} to {} are not whole rows of {}", first, first + count - 1, width);
  }
  return strips_.Read(static_cast<int>(first / width), static_cast<int>(count / width), pairs, out);
}

}  // namespace mesorig::codecs
