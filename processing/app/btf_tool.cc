// mesorig-btf: the tool on BTF and MDF files.

#include <CLI/CLI.hpp>
#include <charconv>

#include "processing/app/bench_command.h"
#include "processing/app/btf_commands.h"
#include "processing/app/encode_options.h"
#include "processing/app/stripe_command.h"
#include "processing/exchange/importer.h"
#include "protocol/base/program.h"

namespace {

using mesorig::Status;
namespace processing = mesorig::processing;
namespace codecs = mesorig::codecs;

template <typename Registry>
std::string Names(const Registry& registry) {
  std::string names;
  for (const auto* entry : registry) names += (names.empty() ? "" : ", ") + std::string(entry->name());
  return names;
}

// "X,Y,W,H".
bool SetRegion(const std::string& text, std::array<int, 4>& region) {
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  for (size_t k = 0; k < region.size(); ++k) {
    if (k > 0 && (at == end || *at++ != ',')) return false;
    const auto [next, error] = std::from_chars(at, end, region[k]);
    if (error != std::errc()) return false;
    at = next;
  }
  return at == end;
}

struct Arguments {
  std::string from, to, reference, format = "multi-light", pictures;
  processing::CompressOptions compress;
  processing::SliceOptions slice;
  processing::CrossValidateOptions cross;
  processing::StripeCommand stripe;
  processing::BenchCommand bench;
  bool by_angle = false, json = false;
};

CLI::App* AddCommand(CLI::App& app, const char* name, const char* text, Arguments& a) {
  CLI::App* command = app.add_subcommand(name, text);
  command->add_flag("--json", a.json, "print one JSON object");
  return command;
}

void AddCommands(CLI::App& app, Arguments& a) {
  CLI::App* info = AddCommand(app, "info", "what a BTF or MDF file holds", a);
  info->add_option("file", a.from, "*.btf.exr or *.mdf.exr")->required();

  CLI::App* digest = AddCommand(
      app, "digest", "one digest of all pixels: equal for equal measurements, whoever made them when",
      a);
  digest->add_option("file", a.from, "*.btf.exr or *.mdf.exr")->required();

  CLI::App* import = AddCommand(app, "import", "a foreign format to a BTF file", a);
  import->add_option("from", a.from, "folder or file to read")->required();
  import->add_option("--format", a.format, Names(mesorig::exchange::AllImporters()))
      ->capture_default_str();
  import->add_option("-o,--out", a.to, "BTF file to write")->required();

  CLI::App* compress = AddCommand(
      app, "compress",
      "compress a BTF file; prints seconds, bytes, errors and the ratio: bytes that the samples "
      "present would have as half, without any packing, over bytes of the file written", a);
  compress->add_option("file", a.from, "uncompressed *.btf.exr")->required();
  compress->add_option("--codec", a.compress.codec, Names(codecs::AllEncoders()))->required();
  compress->add_option("-o,--out", a.to, "BTF file to write")->required();
  processing::AddEncodeOptions(compress, a.compress.encode);
  compress->add_option("--target-error", a.compress.target.error,
                       "fewest terms with at most this relative error")->check(CLI::PositiveNumber);
  compress->add_option("--target-bytes", a.compress.target.bytes,
                       "most terms in a file of at most so many bytes")->check(CLI::PositiveNumber);
  compress->add_flag("--stream", a.compress.stream,
                     "read the file in strips, for one that does not fit into memory: 1 GB beside the "
                     "factors at most; errors are not measured");

  CLI::App* compare = AddCommand(
      app, "compare",
      "errors of one BTF file against another, compressed or not, over the pairs present in both; "
      "psnr_db has peak 1/pi sr^-1 (1, code value 255, where not calibrated). Of two MDF files: "
      "errors of the distance, mm, over the measured texels of the views within 60 degrees", a);
  compare->add_option("file", a.from, "*.btf.exr or *.mdf.exr")->required();
  compare->add_option("reference", a.reference, "*.btf.exr or *.mdf.exr, as the file")->required();
  compare->add_flag("--by-angle", a.by_angle, "also per polar angle of the view and of the light");

  CLI::App* report = AddCommand(
      app, "report", "report.json of a run to a page with tables, plots and pictures", a);
  report->add_option("file", a.from, "report.json")->required();
  report->add_option("-o,--out", a.to, "page to write, beside it (report.html)");

  CLI::App* cross = AddCommand(
      app, "cross-validate",
      "leave out each light in turn, predict it; PSNR of Rec. 601 grey inside the mask, clipped to "
      "0-255, beside that of a Lambert fit", a);
  cross->add_option("file", a.from, "uncompressed *.btf.exr")->required();
  cross->add_option("--codec", a.cross.codec, Names(codecs::AllEncoders()))->required();
  cross->add_option("--pictures", a.pictures, "folder for PNGs, measured | predicted a light");
  processing::AddEncodeOptions(cross, a.cross.encode);

  CLI::App* slice = AddCommand(app, "slice", "one image of a BTF file as PNG; of an MDF file the heights that a view shows", a);
  slice->add_option("file", a.from, "*.btf.exr or *.mdf.exr")->required();
  slice->add_option("--view", a.slice.view, "index of the view")->required();
  slice->add_option("--light", a.slice.light, "index of the light (BTF)");
  slice->add_option("--exposure", a.slice.exposure, "factor before sRGB; chosen without it")
      ->check(CLI::PositiveNumber);
  slice->add_option("-o,--out", a.to, "PNG to write")->required();
}

void AddBench(CLI::App& app, Arguments& a) {
  CLI::App* bench = AddCommand(
      app, "bench",
      "every codec at every setting on one BTF: error, PSNR, 99th percentile, what clamping would "
      "add, bytes, time to encode and to decode, memory; with --out a page with plots and a "
      "recommendation", a);
  bench->add_option("file", a.from, "uncompressed *.btf.exr")->required();
  bench->add_option("--codecs", a.bench.codecs, Names(codecs::AllEncoders()))->delimiter(',');
  bench->add_option("--most-terms", a.bench.most_terms, "where the sweep of terms ends")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  processing::AddNegativeOption(bench, a.bench.clamp_negative);
  bench->add_option("--errors", a.bench.error_limits,
                    "relative errors to recommend the smallest and the fastest codec under")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  bench->add_option("--materials", a.bench.materials,
                    "BTF files whose RMS error against terms of fmf is shown in one plot")
      ->delimiter(',');
  bench->add_option("-o,--out", a.bench.out, "folder to write");
}

void AddStripe(CLI::App& app, Arguments& a) {
  CLI::App* stripe = AddCommand(
      app, "stripe",
      "fit the line of a laser stripe in each photograph; prints its position (where it crosses the "
      "middle of the region, along rows or columns), its angle (0 to the right, 90 upwards) and how "
      "they scatter over the photographs", a);
  stripe->add_option("images", a.stripe.images, "PNG, JPEG or TGA, 8 bits, of one size")->required();
  stripe
      ->add_option_function<std::string>(
          "--region", [&a](const std::string& text) {
            if (!SetRegion(text, a.stripe.region.emplace())) {
              throw CLI::ValidationError("--region", "`" + text + "` is not X,Y,W,H in pixels");
            }
          },
          "pixels to look at; without it the whole image")
      ->type_name("X,Y,W,H");
}

Status Run(const CLI::App& app, Arguments& a) {
  if (app.got_subcommand("info")) return processing::Info(a.from, a.json);
  if (app.got_subcommand("digest")) return processing::Digest(a.from, a.json);
  if (app.got_subcommand("import")) return processing::Import(a.from, a.format, a.to, a.json);
  if (app.got_subcommand("report")) return processing::Report(a.from, a.to, a.json);
  if (app.got_subcommand("compare")) return processing::Compare(a.from, a.reference, a.by_angle, a.json);
  if (app.got_subcommand("compress")) {
    a.compress.from = a.from;
    a.compress.to = a.to;
    a.compress.json = a.json;
    return processing::Compress(a.compress);
  }
  if (app.got_subcommand("slice")) {
    a.slice.from = a.from;
    a.slice.to = a.to;
    a.slice.json = a.json;
    return processing::Slice(a.slice);
  }
  if (app.got_subcommand("stripe")) {
    a.stripe.json = a.json;
    return processing::FitStripes(a.stripe);
  }
  if (app.got_subcommand("bench")) {
    a.bench.from = a.from;
    a.bench.json = a.json;
    return processing::Bench(a.bench);
  }
  a.cross.from = a.from;
  a.cross.json = a.json;
  if (!a.pictures.empty()) a.cross.pictures = a.pictures;
  return processing::CrossValidateFile(a.cross);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "mesorig-btf: the tool on BTF files (how a material looks from every view under every light) "
      "and MDF files (the shape of its fine relief).\nExample: mesorig-btf compress sample.btf.exr --codec view-svd --out small.btf.exr");
  app.require_subcommand(1);
  Arguments arguments;
  AddCommands(app, arguments);
  AddStripe(app, arguments);
  AddBench(app, arguments);
  return mesorig::RunProgram(app, "mesorig-btf", argc, argv, [&] { return Run(app, arguments); });
}
