#include <array>
#include <cmath>

#include "processing/codecs/algebra/threads.h"
#include "processing/codecs/bench.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"
#include "tests/bench/codecs.h"

namespace mesorig::bench {
namespace {

constexpr int kSide = 128, kDirections = 96, kRounds = 2;
constexpr int kSmallSide = 32, kFewDirections = 48, kThreadRounds = 3;

// Something with a lobe, cheap to compute, and noise, so that it does not pack into nothing.
btf::SampledBtf Example(int side = kSide, int directions = kDirections) {
  btf::BtfHeader h;
  h.width = h.height = side;
  h.pitch_mm = 0.1;
  h.views = h.lights = Directions(directions);
  btf::SampledBtf btf(h);
  std::vector<float> texture(btf.image_size()), noise(1 << 16);
  uint32_t state = 1;
  for (auto* const values : {&texture, &noise}) {
    for (float& x : *values) {
      state = state * 1664525u + 1013904223u;
      x = static_cast<float>(state >> 8) * 0x1p-24f;
    }
  }
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      btf.SetPresent(v, l, true);
      const Vec3 light = h.lights[static_cast<size_t>(l)];
      const double z = Normalized(h.views[static_cast<size_t>(v)] + light).z;
      const auto diffuse = static_cast<float>(light.z), lobe = static_cast<float>(std::pow(z, 30.0));
      auto image = btf.MutableImage(v, l);
      const auto shift = static_cast<size_t>(v * 131 + l * 17);
      for (size_t i = 0; i < image.size(); ++i) {
        image[i] = diffuse * (0.3f * texture[i] + lobe * texture[(i + 700) % texture.size()]) *
                   (1 + 0.03f * noise[(i + shift) % noise.size()]);
      }
    }
  }
  return btf;
}

// The factors as the file stores them, but as float.
double FactorBytes(const codecs::EncodedBtf& encoded) {
  double bytes = 0;
  for (const btf::Plane& plane : encoded.Planes()) bytes += 4.0 * static_cast<double>(plane.values.size());
  return bytes;
}

}  // namespace

StatusOr<nlohmann::json> EncodeFromFile(const std::filesystem::path& dir) {
  const std::filesystem::path file = dir / "bench.btf.exr";
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(Example(), file));
  codecs::algebra::SetThreads(kThreads);
  MESORIG_ASSIGN_OR_RETURN(const codecs::Encoder* encoder, codecs::FindEncoder("view-svd"));
  double read_s = 1e9, memory_s = 1e9, stream_s = 1e9;
  for (int round = 0; round < kRounds; ++round) {  // taking turns; the file is in the page cache
    Status status = OkStatus();
    double only_read = 0;
    const double both = Seconds([&] {
      StatusOr<btf::SampledBtf> btf = InvalidArgument("not read");
      only_read = Seconds([&] { btf = btf::ReadSampledBtf(file); });
      status = btf.status();
      if (status.ok()) status = encoder->Encode(*btf, {}).status();
    });
    MESORIG_RETURN_IF_ERROR(status);
    read_s = std::min(read_s, only_read), memory_s = std::min(memory_s, both);
    stream_s = std::min(stream_s, Seconds([&] {
      auto strips = btf::BtfStrips::Open(file);
      status = strips.status();
      if (!status.ok()) return;
      status = encoder->EncodeFrom(codecs::FileSource(*std::move(strips)), {}).status();
    }));
    MESORIG_RETURN_IF_ERROR(status);
  }
  nlohmann::json json;
  json["file_mb"] = 1e-6 * static_cast<double>(std::filesystem::file_size(file));
  json["read_s"] = read_s;
  json["read_and_encode_s"] = memory_s;
  json["read_and_encode_to_read"] = memory_s / read_s;
  json["strips_s"] = stream_s;
  json["strips_to_read"] = stream_s / read_s;
  std::filesystem::remove(file);
  return json;
}

StatusOr<nlohmann::json> PeaksOfStreams(const std::filesystem::path& dir) {
  const std::filesystem::path file = dir / "bench.btf.exr";
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(Example(), file));
  codecs::algebra::SetThreads(kThreads);
  nlohmann::json json;
  for (const codecs::Encoder* encoder : codecs::AllEncoders()) {
    MESORIG_ASSIGN_OR_RETURN(btf::BtfStrips strips, btf::BtfStrips::Open(file));
    const codecs::FileSource source(std::move(strips));
    const codecs::PeakMemory peak;
    StatusOr<std::unique_ptr<codecs::EncodedBtf>> encoded = InvalidArgument("not encoded");
    const double seconds = Seconds([&] { encoded = encoder->EncodeFrom(source, {}); });
    const double bytes = static_cast<double>(peak.Bytes());
    MESORIG_RETURN_IF_ERROR(encoded.status());
    const std::string name(encoder->name());
    json[name + "_s"] = seconds;
    json[name + "_peak_mb"] = 1e-6 * bytes;
    json[name + "_factors_mb"] = 1e-6 * FactorBytes(**encoded);
  }
  std::filesystem::remove(file);
  return json;
}

StatusOr<nlohmann::json> ThreadsOfEncoders() {
  const btf::SampledBtf btf = Example(kSmallSide, kFewDirections);
  nlohmann::json json;
  for (const codecs::Encoder* encoder : codecs::AllEncoders()) {
    std::array<double, 2> seconds = {1e9, 1e9}, errors{};
    for (int round = 0; round < 2 * kThreadRounds; ++round) {  // taking turns
      const auto turn = static_cast<size_t>(round % 2);
      codecs::algebra::SetThreads(round % 2 + 1);
      StatusOr<std::unique_ptr<codecs::EncodedBtf>> encoded = InvalidArgument("not encoded");
      seconds[turn] = std::min(seconds[turn], Seconds([&] { encoded = encoder->Encode(btf, {}); }));
      MESORIG_RETURN_IF_ERROR(encoded.status());
      errors[turn] = codecs::MeasureDecoded(**encoded, btf).rel_error;
    }
    const std::string name(encoder->name());
    json[name + "_one_thread_s"] = seconds[0];
    json[name + "_two_threads_times_faster"] = seconds[0] / seconds[1];
    json[name + "_error_differs_by"] = std::abs(errors[0] - errors[1]);
  }
  return json;
}

}  // namespace mesorig::bench
