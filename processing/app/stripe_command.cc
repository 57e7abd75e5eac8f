#include "processing/app/stripe_command.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "processing/image/image_file.h"
#include "processing/mesostructure/stripe.h"
#include "protocol/base/geometry.h"

namespace mesorig::processing {
namespace {

using mesostructure::Profiles;
using mesostructure::StripeImage;
using mesostructure::StripeLine;
using mesostructure::StripeOptions;
using nlohmann::json;

constexpr float kSaturated = 250;  // code value: JPEG does not keep the largest one

struct Region {
  int x = 0, y = 0, width = 0, height = 0;
};

struct Fit {
  std::string file;
  Status status;
  StripeLine line;
  double position_px = 0, position_std_px = 0, angle_rad = 0, angle_std_rad = 0;
};

StatusOr<Region> RegionOf(const StripeCommand& command, const image::Image8& image,
                          const std::string& file) {
  if (!command.region) return Region{0, 0, image.width, image.height};
  const auto [x, y, width, height] = *command.region;
  const bool inside = x >= 0 && y >= 0 && width > 0 && height > 0 && x <= image.width &&
                      y <= image.height && width <= image.width - x && height <= image.height - y;
  if (!inside) {
    return InvalidArgument("{}: region {},{},{},{} does not lie within its {} x {} pixels", file, x,
                           y, width, height, image.width, image.height);
  }
  return Region{x, y, width, height};
}

// The sum of the channels, code values; saturated where the brightest channel is.
StripeImage Crop(const image::Image8& image, const Region& region) {
  StripeImage crop;
  crop.width = region.width, crop.height = region.height;
  crop.saturation = 1e6f;
  for (int j = 0; j < region.height; ++j) {
    const uint8_t* rgb = image.rgb.data() +
                         3 * (static_cast<size_t>(region.y + j) * static_cast<size_t>(image.width) +
                              static_cast<size_t>(region.x));
    for (int i = 0; i < region.width; ++i, rgb += 3) {
      const int sum = rgb[0] + rgb[1] + rgb[2];
      const bool saturated = std::max({rgb[0], rgb[1], rgb[2]}) >= kSaturated;
      crop.value.push_back(static_cast<float>(sum) + (saturated ? crop.saturation : 0));
    }
  }
  return crop;
}

// Angle of the line in [0, pi): 0 runs to the right, pi/2 upwards.
double AngleOf(const StripeLine& line) {
  const double du = line.profiles == Profiles::kRows ? line.slope : 1;
  const double dv = line.profiles == Profiles::kRows ? 1 : line.slope;
  const double angle = std::atan2(-dv, du);
  return angle < 0 ? angle + kPi : angle;
}

Fit FitOne(const StripeImage& crop, Profiles profiles, const Region& region, std::string file) {
  Fit fit;
  fit.file = std::move(file);
  const StripeOptions options;
  const auto line = FitStripeLine(FindStripe(crop, profiles, options), profiles, options);
  fit.status = line.status();
  if (!line.ok()) return fit;
  const bool rows = profiles == Profiles::kRows;
  const double middle = 0.5 * (rows ? region.height : region.width);
  fit.line = *line;
  fit.position_px = line->At(middle) + (rows ? region.x : region.y);
  fit.position_std_px = std::sqrt(line->VarianceAt(middle));
  fit.angle_rad = AngleOf(*line);
  fit.angle_std_rad = std::sqrt(line->slope_variance) / (1 + line->slope * line->slope);
  return fit;
}

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t n = values.size();
  return n % 2 != 0 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

struct Scatter {
  double mean = 0, deviation = 0, mad = 0;  // standard deviation; median absolute deviation
};

Scatter ScatterOf(const std::vector<double>& values) {
  Scatter scatter;
  const auto n = static_cast<double>(values.size());
  for (const double x : values) scatter.mean += x / n;
  double squares = 0;
  for (const double x : values) squares += (x - scatter.mean) * (x - scatter.mean);
  if (values.size() > 1) scatter.deviation = std::sqrt(squares / (n - 1));
  const double median = Median(values);
  std::vector<double> apart;
  for (const double x : values) apart.push_back(std::abs(x - median));
  scatter.mad = Median(apart);
  return scatter;
}

struct Summary {
  bool rows = false;
  Scatter position, angle;
  size_t fitted = 0;
};

void PrintJson(const std::vector<Fit>& fits, const Summary& s) {
  json images = json::array();
  for (const Fit& fit : fits) {
    json entry = {{"file", fit.file}};
    if (fit.status.ok()) {
      entry.update({{"position_px", fit.position_px},
                    {"position_std_px", fit.position_std_px},
                    {"angle_deg", DegFromRad(fit.angle_rad)},
                    {"angle_std_deg", DegFromRad(fit.angle_std_rad)},
                    {"profiles", fit.line.candidates},
                    {"inliers", fit.line.inliers}});
    } else {
      entry["refused"] = std::string(Message(fit.status));
    }
    images.push_back(entry);
  }
  json result = {{"profiles", s.rows ? "rows" : "columns"},
                 {"images", fits.size()},
                 {"fitted", s.fitted},
                 {"position_px", s.position.mean},
                 {"angle_deg", DegFromRad(s.angle.mean)},
                 {"position_std_px", nullptr},
                 {"position_mad_px", nullptr},
                 {"angle_std_deg", nullptr},
                 {"fits", images}};
  if (s.fitted > 1) {
    result["position_std_px"] = s.position.deviation;
    result["position_mad_px"] = s.position.mad;
    result["angle_std_deg"] = DegFromRad(s.angle.deviation);
  }
  fmt::print("{}\n", result.dump(2));
}

void PrintText(const std::vector<Fit>& fits, const Summary& s) {
  for (const Fit& fit : fits) {
    if (fit.status.ok()) {
      fmt::print("{}: {} {:.3f} px (+- {:.3f}), angle {:.3f} deg, {} of {} profiles\n", fit.file,
                 s.rows ? "u" : "v", fit.position_px, fit.position_std_px,
                 DegFromRad(fit.angle_rad), fit.line.inliers, fit.line.candidates);
    } else {
      fmt::print("{}: {}\n", fit.file, Message(fit.status));
    }
  }
  fmt::print("{} of {} images, along {}: position {:.3f} px, angle {:.3f} deg\n", s.fitted,
             fits.size(), s.rows ? "rows" : "columns", s.position.mean, DegFromRad(s.angle.mean));
  if (s.fitted < 2) return;
  fmt::print(
      "over images: position std {:.4f} px, median absolute deviation {:.4f} px, angle std "
      "{:.4f} deg\n",
      s.position.deviation, s.position.mad, DegFromRad(s.angle.deviation));
}

}  // namespace

Status FitStripes(const StripeCommand& command) {
  std::vector<Fit> fits;
  std::vector<double> positions, angles;
  std::optional<Profiles> profiles;
  for (const std::filesystem::path& path : command.images) {
    MESORIG_ASSIGN_OR_RETURN(const image::Image8 photograph, image::ReadImage(path));
    MESORIG_ASSIGN_OR_RETURN(const Region region, RegionOf(command, photograph, path.string()));
    const StripeImage crop = Crop(photograph, region);
    // Positions of different directions could not be compared: the first photograph decides.
    if (!profiles) profiles = ChooseProfiles(crop, StripeOptions());
    fits.push_back(FitOne(crop, *profiles, region, path.string()));
    if (!fits.back().status.ok()) continue;
    positions.push_back(fits.back().position_px);
    angles.push_back(fits.back().angle_rad);
  }
  if (positions.empty()) {
    return FailedPrecondition("none of {} images shows a stripe; {}: {}", fits.size(),
                              fits.front().file, Message(fits.front().status));
  }
  // A line that runs to the right has angles around 0 and pi.
  for (double& angle : angles) {
    if (angle - angles.front() > kPi / 2) angle -= kPi;
    if (angle - angles.front() < -kPi / 2) angle += kPi;
  }
  const Summary summary{*profiles == Profiles::kRows, ScatterOf(positions), ScatterOf(angles),
                        positions.size()};
  if (command.json) {
    PrintJson(fits, summary);
  } else {
    PrintText(fits, summary);
  }
  return OkStatus();
}

}  // namespace mesorig::processing
