#include "processing/app/bench_command.h"

#include <algorithm>
#include <cmath>

#include "processing/app/png_file.h"
#include "processing/app/progress_bar.h"
#include "processing/btf/btf_file.h"
#include "processing/btf/errors.h"
#include "processing/codecs/bench.h"
#include "processing/report/bench_report.h"

namespace mesorig::processing {
namespace {

constexpr double kDifferenceGain = 2;
constexpr int kPictureWidth = 320;  // of one apparent BRDF, about: pairs become squares

StatusOr<std::vector<const codecs::Encoder*>> Chosen(const std::vector<std::string>& names) {
  if (names.empty()) return codecs::AllEncoders();
  std::vector<const codecs::Encoder*> encoders;
  for (const std::string& name : names) {
    MESORIG_ASSIGN_OR_RETURN(const codecs::Encoder* encoder, codecs::FindEncoder(name));
    encoders.push_back(encoder);
  }
  return encoders;
}

// A dark texel, one of middle brightness and a bright one: the tenths 1, 5 and 9 of all inside the mask.
std::vector<size_t> TypicalTexels(const btf::SampledBtf& btf) {
  const btf::BtfHeader& h = btf.header();
  std::vector<double> sums(h.texel_count(), 0.0);
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      const auto image = btf.Image(v, l);
      for (size_t i = 0; i < image.size(); ++i) sums[i / 3] += image[i];
    }
  }
  std::vector<size_t> texels;
  for (size_t i = 0; i < sums.size(); ++i) {
    if (h.InMask(i)) texels.push_back(i);
  }
  std::stable_sort(texels.begin(), texels.end(), [&](size_t a, size_t b) { return sums[a] < sums[b]; });
  std::vector<size_t> chosen;
  for (const size_t tenth : {1, 5, 9}) {
    if (texels.empty()) break;
    const size_t texel = texels[tenth * (texels.size() - 1) / 10];
    if (std::count(chosen.begin(), chosen.end(), texel) == 0) chosen.push_back(texel);
  }
  return chosen;
}

// The apparent BRDFs of these texels, one below the other: a row a view, a column a light; absent pairs
// are black.
std::vector<float> Abrdfs(const btf::BtfHeader& h, const std::vector<uint8_t>& present,
                          const std::vector<size_t>& texels,
                          const std::function<std::span<const float>(int, int)>& image) {
  std::vector<float> pixels(3 * present.size() * texels.size(), 0.0f);
  for (size_t pair = 0; pair < present.size(); ++pair) {
    if (present[pair] == 0) continue;
    const auto from = image(static_cast<int>(pair / h.lights.size()),
                            static_cast<int>(pair % h.lights.size()));
    for (size_t t = 0; t < texels.size(); ++t) {
      std::copy_n(from.data() + 3 * texels[t], 3, pixels.data() + 3 * (t * present.size() + pair));
    }
  }
  return pixels;
}

double ExposureOf(std::vector<float> values) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 98 / 100);
  std::nth_element(values.begin(), at, values.end());
  return *at > 0 ? 1.0 / *at : 1.0;
}

// Every pixel becomes a square.
std::vector<float> Enlarged(const std::vector<float>& rgb, int width, int factor) {
  const auto w = static_cast<size_t>(width), f = static_cast<size_t>(factor);
  std::vector<float> large(rgb.size() * f * f);
  for (size_t i = 0; i < large.size() / 3; ++i) {
    const size_t from = i / (w * f) / f * w + i % (w * f) / f;
    std::copy_n(rgb.data() + 3 * from, 3, large.data() + 3 * i);
  }
  return large;
}

// Original, decoded and the difference (white is none), side by side.
Status WriteAbrdfs(const btf::SampledBtf& btf, const codecs::EncodedBtf& encoded,
                   const std::vector<size_t>& texels, const std::filesystem::path& png) {
  const btf::BtfHeader& h = btf.header();
  std::vector<float> decoded(btf.image_size());
  const std::vector<float> a =
      Abrdfs(h, encoded.info().present, texels, [&](int v, int l) { return btf.Image(v, l); });
  const std::vector<float> b = Abrdfs(h, encoded.info().present, texels, [&](int v, int l) {
    encoded.DecodeImage(v, l, decoded);
    return std::span<const float>(decoded);
  });
  const double exposure = ExposureOf(a);
  std::vector<float> difference(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    difference[i] = static_cast<float>(1 - kDifferenceGain * exposure * std::abs(b[i] - a[i]));
  }
  const auto picture = [&](const std::vector<float>& values, double e) {
    const int factor = std::max(1, kPictureWidth / h.light_count());
    const auto rows = static_cast<int>(texels.size()) * h.view_count();
    return PictureOf(h.light_count() * factor, rows * factor,
                     Enlarged(values, h.light_count(), factor), e, !h.calibrated);
  };
  return WritePng(SideBySide(SideBySide(picture(a, exposure), picture(b, exposure)),
                             picture(difference, 1)), png);
}

report::BenchRow RowOf(const codecs::BenchPoint& point, const codecs::BenchResult& result,
                       double raw_bytes) {
  report::BenchRow row;
  row.codec = point.encoder->name();
  row.series = point.series;
  row.label = point.label;
  row.options_json = result.options_json;
  row.rel_error = result.errors.rel_error;
  row.rmse = result.errors.rmse;
  row.psnr_db = result.errors.psnr_db;
  row.p99_abs = result.errors.p99_abs;
  row.max_abs = result.errors.max_abs;
  row.clamped_mass = result.errors.clamped_mass;
  row.bytes = static_cast<double>(result.bytes);
  row.ratio = raw_bytes / row.bytes;
  row.encode_s = result.encode_s;
  row.image_samples_per_s = result.image_samples_per_s;
  row.access_samples_per_s = result.access_samples_per_s;
  row.peak_bytes = static_cast<double>(result.peak_bytes);
  return row;
}

std::string FileNameOf(const report::BenchRow& row) {
  std::string name = "abrdf_" + row.series + (row.label.empty() ? "" : "_" + row.label) + ".png";
  std::erase_if(name, [](char c) { return c == ',' || c == ' '; });
  return name;
}

// RMS errors of fmf at powers of two of terms.
Status AddMaterial(const std::filesystem::path& file, int most_terms,
                   std::vector<report::BenchRow>& rows) {
  MESORIG_ASSIGN_OR_RETURN(const codecs::Encoder* fmf, codecs::FindEncoder("fmf"));
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf btf, btf::ReadSampledBtf(file));
  codecs::EncodeOptions options;
  const int most = std::min(most_terms, fmf->max_terms(btf));
  for (options.terms = 1; options.terms <= most; options.terms *= 2) {
    const auto encoded = codecs::EncodeBtf(*fmf, btf, options);
    if (!encoded.ok()) return Annotate(encoded.status(), file.string());
    report::BenchRow row;
    row.codec = row.series = file.stem().stem().string();
    row.label = fmt::format("{}", options.terms);
    row.rmse = codecs::MeasureDecoded(**encoded, btf).rmse;
    rows.push_back(std::move(row));
  }
  return OkStatus();
}

void PrintRow(const report::BenchRow& r) {
  fmt::print("{:<18}{:>6}{:>10.4f}{:>9.2f}{:>11.2g}{:>10.1e}{:>11.3f}{:>8.1f}{:>9.2f}{:>10.1f}{:>10.3f}{:>8.0f}\n",
             r.series, r.label, r.rel_error, r.psnr_db, r.p99_abs, r.clamped_mass, r.bytes * 1e-6,
             r.ratio, r.encode_s, r.image_samples_per_s * 1e-6, r.access_samples_per_s * 1e-6,
             r.peak_bytes * 1e-6);
}

void PrintHead() {
  fmt::print("{:<18}{:>6}{:>10}{:>9}{:>11}{:>10}{:>11}{:>8}{:>9}{:>10}{:>10}{:>8}\n", "codec",
             "terms", "error", "PSNR", "99th pct", "clamped", "MB", "ratio", "encode s", "image M/s",
             "access M/s", "peak MB");
}

void PrintRecommendation(const report::BenchReport& report) {
  for (const report::Recommendation& r : report::Recommend(report)) {
    if (!r.smallest || !r.fastest) {
      fmt::print("error at most {:g}: none of these\n", r.limit);
      continue;
    }
    const report::BenchRow &small = report.rows[*r.smallest], &fast = report.rows[*r.fastest];
    fmt::print("error at most {:g}: smallest {} {} ({:.3f} MB), fastest at random access {} {} ({:.2f} M/s)\n",
               r.limit, small.series, small.label, small.bytes * 1e-6, fast.series, fast.label,
               fast.access_samples_per_s * 1e-6);
  }
}

}  // namespace

Status Bench(const BenchCommand& command) {
  ProgressBar progress("bench");
  MESORIG_ASSIGN_OR_RETURN(const auto encoders, Chosen(command.codecs));
  MESORIG_ASSIGN_OR_RETURN(const btf::SampledBtf btf, btf::ReadSampledBtf(command.from));
  const btf::BtfHeader& h = btf.header();
  std::vector<codecs::BenchPoint> points;
  for (const codecs::Encoder* encoder : encoders) {
    for (auto& point : codecs::Sweep(*encoder, btf, command.most_terms)) {
      point.options.clamp_negative = command.clamp_negative;
      points.push_back(std::move(point));
    }
  }
  if (command.out) {
    std::error_code error;
    std::filesystem::create_directories(*command.out, error);
    if (error) return Unavailable("{}: {}", command.out->string(), error.message());
  }
  report::BenchReport report;
  report.input = command.from.filename().string();
  report.what = fmt::format("{} x {} texels, {} views x {} lights, {} pairs present", h.width,
                            h.height, h.view_count(), h.light_count(), btf.present_count());
  report.peak = btf::PsnrPeak(h);
  report.calibrated = h.calibrated;
  report.file_bytes = static_cast<double>(std::filesystem::file_size(command.from));
  if (!command.error_limits.empty()) report.error_limits = command.error_limits;
  const std::vector<size_t> texels = TypicalTexels(btf);
  if (!command.json) PrintHead();
  for (size_t i = 0; i < points.size(); ++i) {
    progress.Show(static_cast<double>(i) / static_cast<double>(points.size()));
    const auto measured = codecs::Measure(points[i], btf);
    if (!measured.ok()) {
      if (absl::IsInvalidArgument(measured.status()) && command.codecs.empty()) continue;
      return Annotate(measured.status(), points[i].series);
    }
    report.raw_bytes = static_cast<double>(btf::UncompressedBytes(h, measured->encoded->info().present));
    report::BenchRow row = RowOf(points[i], *measured, report.raw_bytes);
    const auto by_angle = report::ErrorsByAngle(codecs::DecodeAll(*measured->encoded), btf);
    if (by_angle.ok()) row.by_angle = *by_angle;
    if (command.out) {
      row.picture = FileNameOf(row);
      MESORIG_RETURN_IF_ERROR(
          WriteAbrdfs(btf, *measured->encoded, texels, *command.out / *row.picture));
    }
    if (!command.json) PrintRow(row);
    report.rows.push_back(std::move(row));
  }
  for (const std::filesystem::path& material : command.materials) {
    MESORIG_RETURN_IF_ERROR(AddMaterial(material, command.most_terms, report.materials));
  }
  if (command.out) {
    MESORIG_ASSIGN_OR_RETURN(const auto skipped, report::WriteBench(report, *command.out));
    for (const std::string& line : skipped) fmt::print(stderr, "skipped {}\n", line);
  }
  if (command.json) {
    fmt::print("{}\n", report::BenchJson(report));
  } else {
    PrintRecommendation(report);
  }
  return OkStatus();
}

}  // namespace mesorig::processing
