#include <array>
#include <random>

#include "processing/codecs/view_svd/view_svd.h"
#include "tests/bench/codecs.h"

namespace mesorig::bench {
namespace {

constexpr int kSide = 128, kTerms = 4, kRounds = 20;
constexpr size_t kQueries = size_t{1} << 17, kBatch = 4096;
constexpr size_t kTriad = size_t{1} << 24;  // floats of each of its arrays, both threads together

using codecs::SampleQuery;
using codecs::view_svd::ViewSvdBtf;

// Factors without an encoder: any numbers decode equally fast.
StatusOr<std::unique_ptr<ViewSvdBtf>> Factors() {
  btf::BtfFileInfo info;
  info.header.width = info.header.height = kSide;
  info.header.pitch_mm = 0.1;
  info.header.views = info.header.lights = Directions(96);
  info.codec = codecs::view_svd::kName;
  info.codec_options_json = "{}";
  info.present.assign(info.header.views.size() * info.header.lights.size(), 1);
  std::minstd_rand random(1);
  const auto numbers = [&](size_t count) {
    std::vector<float> values(count);
    for (float& x : values) x = static_cast<float>(random()) * 0x1p-31f;
    return values;
  };
  auto weights = numbers(info.header.views.size() * kTerms);
  auto textures = numbers(info.header.lights.size() * info.header.texel_count() * kTerms * 3);
  return ViewSvdBtf::Create(std::move(info), kTerms, codecs::Quantisation::kFloat,
                            std::move(weights), std::move(textures));
}

// Texels at random; directions anywhere in the measured cone, or at nodes.
std::vector<SampleQuery> Queries(const btf::BtfHeader& h, bool at_nodes) {
  std::mt19937 random(2);
  const auto uniform = [&] { return static_cast<double>(random()) * 0x1p-32; };
  const auto direction = [&](const std::vector<Vec3>& nodes) {
    if (at_nodes) return nodes[random() % nodes.size()];
    return DirectionFromAngles(std::acos(1 - uniform() * (1 - std::cos(RadFromDeg(75)))),
                               2 * kPi * uniform());
  };
  std::vector<SampleQuery> queries(kQueries);
  for (SampleQuery& q : queries) {
    q = {static_cast<int>(random() % kSide), static_cast<int>(random() % kSide),
         direction(h.views), direction(h.lights)};
  }
  return queries;
}

std::vector<codecs::NodeQuery> Nodes(const btf::BtfHeader& h) {
  std::mt19937 random(3);
  std::vector<codecs::NodeQuery> queries(kQueries);
  for (codecs::NodeQuery& q : queries) {
    q = {static_cast<int>(random() % kSide), static_cast<int>(random() % kSide),
         static_cast<int>(random() % h.views.size()), static_cast<int>(random() % h.lights.size())};
  }
  return queries;
}

// Samples a second, both threads together. `decode(first, count)`.
double Rate(const std::function<void(size_t, size_t)>& decode) {
  const double seconds = Best(kRounds, [&] {
    return SecondsOnThreads([&](int thread) {
      const size_t part = kQueries / kThreads, begin = static_cast<size_t>(thread) * part;
      for (size_t first = begin; first < begin + part; first += kBatch) decode(first, kBatch);
    });
  });
  return static_cast<double>(kQueries) / seconds;
}

// Every light once, one view.
double ImageRate(const codecs::EncodedBtf& btf) {
  const btf::BtfHeader& h = btf.info().header;
  const double seconds = Best(kRounds, [&] {
    return SecondsOnThreads([&](int thread) {
      std::vector<float> image(3 * h.texel_count());
      for (int l = thread; l < h.light_count(); l += kThreads) btf.DecodeImage(5, l, image);
    });
  });
  return static_cast<double>(h.lights.size() * h.texel_count()) / seconds;
}

// a = b + s c, bytes a second that the program asks for (McCalpin's STREAM).
double TriadRate() {
  std::vector<float> a(kTriad, 0.0f), b(kTriad, 1.0f), c(kTriad, 2.0f);
  const double seconds = Best(kRounds, [&] {
    return SecondsOnThreads([&](int thread) {
      const size_t part = kTriad / kThreads, first = static_cast<size_t>(thread) * part;
      float* const to = a.data() + first;
      const float *const x = b.data() + first, *const y = c.data() + first;
      for (size_t i = 0; i < part; ++i) to[i] = x[i] + 3.0f * y[i];
    });
  });
  return 12.0 * static_cast<double>(kTriad) / seconds;
}

}  // namespace

StatusOr<nlohmann::json> DecodeRates() {
  MESORIG_ASSIGN_OR_RETURN(const auto btf, Factors());
  const auto at_nodes = Queries(btf->info().header, true);
  const auto anywhere = Queries(btf->info().header, false);
  const std::vector<codecs::NodeQuery> nodes = Nodes(btf->info().header);
  std::vector<std::array<float, 3>> out(kQueries);
  const auto batch = [&](const std::vector<SampleQuery>& queries) {
    return 1e-6 * Rate([&](size_t first, size_t count) {
      btf->EvaluateBatch(std::span(queries).subspan(first, count),
                         std::span(out).subspan(first, count));
    });
  };
  nlohmann::json json;
  json["nodes_m_per_s"] = 1e-6 * Rate([&](size_t first, size_t count) {
    btf->DecodeSamples(std::span(nodes).subspan(first, count), std::span(out).subspan(first, count));
  });
  json["directions_of_nodes_m_per_s"] = batch(at_nodes);
  json["interpolated_m_per_s"] = batch(anywhere);
  json["interpolated_one_by_one_m_per_s"] = 1e-6 * Rate([&](size_t first, size_t count) {
    for (size_t i = first; i < first + count; ++i) {
      const auto& [x, y, v, l] = anywhere[i];
      out[i] = static_cast<const codecs::EncodedBtf&>(*btf).Evaluate(x, y, v, l);
    }
  });
  // 4 terms of RGB read, RGB written.
  const double images = ImageRate(*btf), bytes = images * 12 * (kTerms + 1), triad = TriadRate();
  json["images_m_per_s"] = 1e-6 * images;
  json["images_gb_per_s"] = 1e-9 * bytes;
  json["triad_gb_per_s"] = 1e-9 * triad;
  json["images_to_triad"] = bytes / triad;
  return json;
}

}  // namespace mesorig::bench
