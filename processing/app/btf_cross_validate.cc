#include <nlohmann/json.hpp>

#include "processing/app/btf_commands.h"
#include "processing/app/png_file.h"
#include "processing/app/progress_bar.h"
#include "processing/btf/btf_file.h"
#include "processing/btf/errors.h"
#include "processing/codecs/cross_validate.h"

namespace mesorig::processing {
namespace {

using nlohmann::json;

// measured | predicted, one file a light.
codecs::OnPrediction PictureWriter(const btf::BtfHeader& header,
                                   const std::filesystem::path& folder) {
  return [&header, folder](int view, int light, std::span<const float> measured,
                           std::span<const float> predicted) {
    const double exposure = header.calibrated ? kPi : 1.0;
    const auto picture = [&](std::span<const float> image) {
      return PictureOf(header.width, header.height, image, exposure, !header.calibrated);
    };
    const std::string name = header.view_count() == 1
                                 ? fmt::format("light_{:03}.png", light)
                                 : fmt::format("view_{:03}_light_{:03}.png", view, light);
    return WritePng(SideBySide(picture(measured), picture(predicted)), folder / name);
  };
}

json ResultJson(const codecs::CrossValidation& result, const CrossValidateOptions& options) {
  json lights = json::array();
  for (const codecs::LightScore& score : result.lights) {
    lights.push_back({{"light", score.light},
                      {"psnr_db", score.psnr_db},
                      {"lambert_psnr_db", score.lambert_psnr_db}});
  }
  return {{"codec", options.codec},
          {"psnr_db", result.psnr_db},
          {"lambert_psnr_db", result.lambert_psnr_db},
          {"lights", lights},
          {"seconds", result.seconds}};
}

}  // namespace

Status CrossValidateFile(const CrossValidateOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const codecs::Encoder* encoder, codecs::FindEncoder(options.codec));
  MESORIG_ASSIGN_OR_RETURN(btf::SampledBtf btf, btf::ReadSampledBtf(options.from));
  codecs::OnPrediction on_prediction;
  if (options.pictures) {
    std::error_code error;
    std::filesystem::create_directories(*options.pictures, error);
    if (error) return InvalidArgument("{}: {}", options.pictures->string(), error.message());
    on_prediction = PictureWriter(btf.header(), *options.pictures);
  }
  codecs::CrossValidation result;
  {
    ProgressBar progress("cross-validate");
    MESORIG_ASSIGN_OR_RETURN(
        result, codecs::CrossValidate(btf, *encoder, options.encode, on_prediction,
                                      [&](double fraction) { progress.Show(fraction); }));
  }
  if (options.json) {
    fmt::print("{}\n", ResultJson(result, options).dump(2));
    return OkStatus();
  }
  fmt::print("light  psnr_db  lambert_psnr_db\n");
  for (const codecs::LightScore& score : result.lights) {
    fmt::print("{:5}  {:7.2f}  {:15.2f}\n", score.light, score.psnr_db, score.lambert_psnr_db);
  }
  fmt::print("  all  {:7.2f}  {:15.2f}   ({} {:.2f} s)\n", result.psnr_db, result.lambert_psnr_db,
             options.codec, result.seconds);
  return OkStatus();
}

}  // namespace mesorig::processing
