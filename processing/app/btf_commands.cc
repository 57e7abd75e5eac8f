#include "processing/app/btf_commands.h"

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>

#include "processing/app/mdf_commands.h"
#include "processing/app/png_file.h"
#include "processing/app/progress_bar.h"
#include "processing/btf/btf_file.h"
#include "processing/btf/errors.h"
#include "processing/btf/file_kind.h"
#include "processing/btf/pixel_digest.h"
#include "processing/codecs/linear/sample_source.h"
#include "processing/exchange/importer.h"
#include "processing/report/errors_by_angle.h"

namespace mesorig::processing {
namespace {

using nlohmann::json;

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

size_t PresentCount(const btf::BtfFileInfo& info) {
  return static_cast<size_t>(std::count(info.present.begin(), info.present.end(), uint8_t{1}));
}

json Directions(const std::vector<Vec3>& directions) {
  json list = json::array();
  for (const Vec3& d : directions) list.push_back({d.x, d.y, d.z});
  return list;
}

json InfoJson(const btf::BtfFileInfo& info) {
  const btf::BtfHeader& h = info.header;
  return {{"codec", info.codec},
          {"codec_version", info.codec_version},
          {"codec_options", json::parse(info.codec_options_json)},
          {"width", h.width},
          {"height", h.height},
          {"pitch_mm", h.pitch_mm},
          {"h_ref_mm", h.h_ref_mm},
          {"views", Directions(h.views)},
          {"lights", Directions(h.lights)},
          {"pairs_present", PresentCount(info)},
          {"pairs", info.present.size()},
          {"cosine_included", h.cosine_included},
          {"calibrated", h.calibrated},
          {"primaries", h.primaries},
          {"masked", !h.mask.empty()},
          {"value_scale", info.value_scale},
          {"negative_values", info.clamp_negative ? "clamp" : "keep"},
          {"provenance", json::parse(h.provenance_json)},
          {"bytes", info.file_bytes},
          {"uncompressed_bytes", btf::UncompressedBytes(h, info.present)}};
}

void Print(const json& object) { fmt::print("{}\n", object.dump(2)); }

json ErrorsJson(const btf::BtfErrors& e) {
  return {{"rel_error", e.rel_error}, {"psnr_db", e.psnr_db}, {"rmse", e.rmse},
          {"max_abs", e.max_abs},     {"peak", e.peak},       {"samples", e.samples},
          {"pairs", e.pairs}};
}

std::string ErrorsText(const btf::BtfErrors& e, bool calibrated) {
  return fmt::format("rel_error {:.3g}, psnr_db {:.2f} (peak {}), rmse {:.3g}, max_abs {:.3g}",
                     e.rel_error, e.psnr_db,
                     calibrated ? "1/pi sr^-1" : "1, code value 255: not calibrated", e.rmse,
                     e.max_abs);
}

json RingsJson(const std::vector<report::AngleErrors>& rings) {
  json list = json::array();
  for (const report::AngleErrors& e : rings) {
    list.push_back({{"theta_deg", e.theta_deg},
                    {"psnr_db", e.psnr_db},
                    {"rel_error", e.rel_error},
                    {"rmse", e.rmse},
                    {"pairs", e.pairs}});
  }
  return list;
}

void PrintRings(const char* what, const std::vector<report::AngleErrors>& rings) {
  for (const report::AngleErrors& e : rings) {
    fmt::print("  {} at {:5.1f} deg: psnr_db {:.2f}, rel_error {:.3g} ({} pairs)\n", what,
               e.theta_deg, e.psnr_db, e.rel_error, e.pairs);
  }
}

// All but the brightest hundredth is below white.
double AutomaticExposure(std::span<const float> image) {
  std::vector<float> sorted(image.begin(), image.end());
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) * 99 / 100);
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at > 0 ? 1.0 / *at : 1.0;
}

}  // namespace

Status Info(const std::filesystem::path& file, bool as_json) {
  MESORIG_ASSIGN_OR_RETURN(const btf::FileKind kind, btf::ReadFileKind(file));
  if (kind == btf::FileKind::kMdf) return MdfInfo(file, as_json);
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo info, btf::ReadBtfInfo(file));
  if (as_json) {
    Print(InfoJson(info));
    return OkStatus();
  }
  const btf::BtfHeader& h = info.header;
  fmt::print("{}: codec {} (version {}, {})\n", file.string(), info.codec, info.codec_version,
             info.codec_options_json);
  fmt::print("  {} x {} texels of {} mm, reference plane at {} mm{}\n", h.width, h.height,
             h.pitch_mm, h.h_ref_mm, h.mask.empty() ? "" : ", with a mask");
  fmt::print("  {} views x {} lights, {} of {} pairs present\n", h.views.size(), h.lights.size(),
             PresentCount(info), info.present.size());
  fmt::print("  {}, cosine of the light {}, primaries {}\n",
             h.calibrated ? "calibrated, sr^-1" : "not calibrated: relative code values",
             h.cosine_included ? "included" : "not included", h.primaries);
  fmt::print("  {} bytes, {} uncompressed\n", info.file_bytes,
             btf::UncompressedBytes(h, info.present));
  fmt::print("  provenance {}\n", h.provenance_json);
  return OkStatus();
}

Status Digest(const std::filesystem::path& file, bool as_json) {
  MESORIG_ASSIGN_OR_RETURN(const std::string digest, btf::PixelDigest(file));
  if (as_json) {
    Print({{"file", file.string()}, {"pixels", digest}});
  } else {
    fmt::print("{}  {}\n", digest, file.string());
  }
  return OkStatus();
}

Status Import(const std::filesystem::path& from, const std::string& format,
              const std::filesystem::path& to, bool as_json) {
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const exchange::Importer* importer, exchange::FindImporter(format));
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf btf, importer->Import(from));
  MESORIG_RETURN_IF_ERROR(btf::WriteSampledBtf(btf, to));
  const btf::BtfHeader& h = btf.header();
  const auto bytes = std::filesystem::file_size(to);
  if (as_json) {
    Print({{"file", to.string()},
           {"width", h.width},
           {"height", h.height},
           {"views", h.views.size()},
           {"lights", h.lights.size()},
           {"calibrated", h.calibrated},
           {"masked", !h.mask.empty()},
           {"bytes", bytes},
           {"seconds", SecondsSince(start)}});
  } else {
    fmt::print("{}: {} x {} texels, {} views x {} lights, {} bytes, {:.2f} s\n", to.string(),
               h.width, h.height, h.views.size(), h.lights.size(), bytes, SecondsSince(start));
  }
  return OkStatus();
}

namespace {

Status CompressStream(const CompressOptions& options, const codecs::Encoder& encoder) {
  if (options.target.error > 0 || options.target.bytes > 0) {
    return InvalidArgument("--stream: the number of terms must be given, no target is looked for");
  }
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(btf::BtfStrips strips, btf::BtfStrips::Open(options.from));
  const codecs::FileSource source(std::move(strips));
  MESORIG_ASSIGN_OR_RETURN(const auto encoded, codecs::EncodeBtf(encoder, source, options.encode));
  const double encode_s = SecondsSince(start);
  MESORIG_RETURN_IF_ERROR(codecs::WriteEncodedBtf(*encoded, options.to));
  const uint64_t raw = btf::UncompressedBytes(source.header(), source.present());
  const uint64_t bytes = std::filesystem::file_size(options.to);
  const double ratio = static_cast<double>(raw) / static_cast<double>(bytes);
  if (options.json) {
    Print({{"file", options.to.string()},
           {"codec", options.codec},
           {"codec_options", json::parse(encoded->info().codec_options_json)},
           {"bytes", bytes},
           {"uncompressed_bytes", raw},
           {"ratio", ratio},
           {"encode_s", encode_s},
           {"seconds", SecondsSince(start)}});
  } else {
    fmt::print("{}: {} bytes, ratio {:.1f}, read and encoded in {:.2f} s\n", options.to.string(),
               bytes, ratio, encode_s);
  }
  return OkStatus();
}

}  // namespace

Status Compress(const CompressOptions& options) {
  ProgressBar progress("compress");
  MESORIG_ASSIGN_OR_RETURN(const codecs::Encoder* encoder, codecs::FindEncoder(options.codec));
  if (options.stream) return CompressStream(options, *encoder);
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf btf, btf::ReadSampledBtf(options.from));
  progress.Show(0.3);
  const auto start = std::chrono::steady_clock::now();
  const bool targeted = options.target.error > 0 || options.target.bytes > 0;
  MESORIG_ASSIGN_OR_RETURN(
      const auto encoded,
      targeted ? codecs::EncodeToTarget(*encoder, btf, options.encode, options.target)
               : codecs::EncodeBtf(*encoder, btf, options.encode));
  const double encode_s = SecondsSince(start);
  progress.Show(0.6);
  MESORIG_RETURN_IF_ERROR(codecs::WriteEncodedBtf(*encoded, options.to));
  progress.Show(0.8);
  const auto decode_start = std::chrono::steady_clock::now();
  const btf::SampledBtf decoded = codecs::DecodeAll(*encoded);
  const double decode_s = SecondsSince(decode_start);
  progress.Show(0.9);
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfErrors errors, btf::CompareBtf(decoded, btf));
  const double clamped_mass = codecs::MeasureDecoded(*encoded, btf).clamped_mass;
  const uint64_t raw = btf::UncompressedBytes(btf.header(), encoded->info().present);
  const uint64_t bytes = std::filesystem::file_size(options.to);
  const double ratio = static_cast<double>(raw) / static_cast<double>(bytes);
  if (options.json) {
    json result = ErrorsJson(errors);
    result.update({{"file", options.to.string()},
                   {"codec", options.codec},
                   {"codec_options", json::parse(encoded->info().codec_options_json)},
                   {"bytes", bytes},
                   {"uncompressed_bytes", raw},
                   {"ratio", ratio},
                   {"clamped_mass", clamped_mass},
                   {"negative_values", encoded->info().clamp_negative ? "clamp" : "keep"},
                   {"encode_s", encode_s},
                   {"decode_s", decode_s},
                   {"seconds", SecondsSince(start)}});
    const json codec_options = result["codec_options"];
    if (codec_options.contains("terms")) result["terms"] = codec_options["terms"];
    Print(result);
    return OkStatus();
  }
  fmt::print("{}: {} bytes, ratio {:.1f}, encoded in {:.2f} s, decoded in {:.2f} s\n",
             options.to.string(), bytes, ratio, encode_s, decode_s);
  fmt::print("  below zero: {:.2g} of the mass, {}\n", clamped_mass,
             encoded->info().clamp_negative ? "clamped" : "kept");
  fmt::print("  {}\n", ErrorsText(errors, btf.header().calibrated));
  return OkStatus();
}

Status Compare(const std::filesystem::path& a, const std::filesystem::path& reference,
               bool by_angle, bool as_json) {
  MESORIG_ASSIGN_OR_RETURN(const btf::FileKind kind, btf::ReadFileKind(a));
  if (kind == btf::FileKind::kMdf) return CompareMdfFiles(a, reference, by_angle, as_json);
  ProgressBar progress("compare");
  const auto start = std::chrono::steady_clock::now();
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf left, codecs::ReadAnyBtf(a));
  progress.Show(0.4);
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf right, codecs::ReadAnyBtf(reference));
  progress.Show(0.8);
  const auto errors = btf::CompareBtf(left, right);
  if (!errors.ok()) {
    return Annotate(errors.status(), fmt::format("{} against {}", a.string(), reference.string()));
  }
  report::ErrorsByAngleResult rings;
  if (by_angle) {
    MESORIG_ASSIGN_OR_RETURN(rings, report::ErrorsByAngle(left, right));
  }
  if (as_json) {
    json result = ErrorsJson(*errors);
    if (by_angle) {
      result["by_view_theta"] = RingsJson(rings.by_view_theta);
      result["by_light_theta"] = RingsJson(rings.by_light_theta);
    }
    result["seconds"] = SecondsSince(start);
    Print(result);
  } else {
    fmt::print("{} pairs, {} values: {}\n", errors->pairs, errors->samples,
               ErrorsText(*errors, right.header().calibrated));
    PrintRings("views", rings.by_view_theta);
    PrintRings("lights", rings.by_light_theta);
  }
  return OkStatus();
}

Status Slice(const SliceOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const btf::FileKind kind, btf::ReadFileKind(options.from));
  if (kind == btf::FileKind::kMdf) {
    if (options.light) return InvalidArgument("--light: an MDF has no lights");
    return SliceMdf(options.from, options.view, options.to, options.json);
  }
  if (!options.light) return InvalidArgument("--light: a slice of a BTF needs one");
  const int light = *options.light;
  MESORIG_ASSIGN_OR_RETURN(const btf::BtfFileInfo info, btf::ReadBtfInfo(options.from));
  const btf::BtfHeader& h = info.header;
  if (options.view < 0 || options.view >= h.view_count() || light < 0 ||
      light >= h.light_count()) {
    return InvalidArgument("{}: view {}, light {}: permitted are views 0 to {}, lights 0 to {}",
                           options.from.string(), options.view, light, h.view_count() - 1,
                           h.light_count() - 1);
  }
  const auto pair = static_cast<size_t>(options.view) * h.lights.size() +
                    static_cast<size_t>(light);
  if (info.present[pair] == 0) {
    return InvalidArgument("{}: view {}, light {} was not measured", options.from.string(),
                           options.view, light);
  }
  std::vector<float> image(3 * h.texel_count());
  if (info.codec == "raw") {
    MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf btf, btf::ReadSampledBtf(options.from));
    const auto from = btf.Image(options.view, light);
    std::copy(from.begin(), from.end(), image.begin());
  } else {
    MESORIG_ASSIGN_OR_RETURN(const auto encoded, codecs::ReadEncodedBtf(options.from));
    encoded->DecodeImage(options.view, light, image);
  }
  double exposure = options.exposure;
  if (exposure <= 0) exposure = h.calibrated ? AutomaticExposure(image) : 1.0;
  MESORIG_RETURN_IF_ERROR(
      WritePng(PictureOf(h.width, h.height, image, exposure, !h.calibrated), options.to));
  if (options.json) {
    Print({{"file", options.to.string()}, {"width", h.width}, {"height", h.height},
           {"exposure", exposure}});
  } else {
    fmt::print("{}: {} x {}, exposure {:.3g}\n", options.to.string(), h.width, h.height, exposure);
  }
  return OkStatus();
}

}  // namespace mesorig::processing
