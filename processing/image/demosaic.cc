#include "processing/image/demosaic.h"

#include <array>
#include <opencv2/imgproc.hpp>

namespace mesorig::image {
namespace {

constexpr int kSmallest = 4;

// Sparse plane of one colour, zeros elsewhere, convolved with these gives bilinear interpolation:
// at the colour's own pixels the weights of its neighbours fall on zeros.
const cv::Matx33f kGreen(0, .25f, 0, .25f, 1, .25f, 0, .25f, 0);
const cv::Matx33f kRedBlue(.25f, .5f, .25f, .5f, 1, .5f, .25f, .5f, .25f);
// Mean over a pixel to value at its centre: 1 - Laplacian / 24.
const float kEdge = -1.0f / 24;
const cv::Matx33f kCentreFromMean(0, kEdge, 0, kEdge, 1 - 4 * kEdge, kEdge, 0, kEdge, 0);

// Mirroring about the border pixel keeps the colours in place.
void Filter(cv::Mat& plane, const cv::Matx33f& kernel) {
  cv::Mat filtered;
  cv::filter2D(plane, filtered, CV_32F, kernel, cv::Point(-1, -1), 0, cv::BORDER_REFLECT_101);
  plane = filtered;
}

// 1 at the colour's own pixels.
cv::Mat MaskOf(const MosaicImage& mosaic, int colour) {
  cv::Mat mask(mosaic.height, mosaic.width, CV_32F, cv::Scalar(0));
  for (int row = 0; row < mosaic.height; ++row) {
    float* out = mask.ptr<float>(row);
    for (int column = 0; column < mosaic.width; ++column) {
      if (ColourAt(mosaic.pattern, column, row) == colour) out[column] = 1;
    }
  }
  return mask;
}

cv::Mat PlaneOf(const MosaicImage& mosaic, int colour) {
  cv::Mat plane(mosaic.height, mosaic.width, CV_32F, cv::Scalar(0));
  const float* in = mosaic.radiance.data();
  for (int row = 0; row < mosaic.height; ++row) {
    float* out = plane.ptr<float>(row);
    for (int column = 0; column < mosaic.width; ++column, ++in) {
      if (ColourAt(mosaic.pattern, column, row) == colour) out[column] = *in;
    }
  }
  return plane;
}

// Where the window always holds samples of every colour: a Gaussian of one pixel, seven wide.
cv::Mat Window(const cv::Mat& plane) {
  cv::Mat mean;
  cv::GaussianBlur(plane, mean, cv::Size(7, 7), 1, 1, cv::BORDER_REFLECT_101);
  return mean;
}

// The line target = slope * guide + offset through the pixels of `mask` in each one's window
// (He et al. 2010, Eqs. 5-6). Two dyes under one changing light lie on such a line; where the guide
// does not vary the slope goes to zero and plain interpolation is left.
struct LocalLine {
  cv::Mat slope, offset;
};
LocalLine FitLine(const cv::Mat& guide, const cv::Mat& target, const cv::Mat& mask) {
  constexpr double kRelativeVariance = 1e-2;  // of the guide's mean: noise, not detail
  constexpr double kTiny = 1e-12;             // a black window
  const cv::Mat weight = Window(mask), masked = guide.mul(mask);
  const cv::Mat mean_g = Window(masked) / weight, mean_t = Window(target.mul(mask)) / weight;
  const cv::Mat variance = Window(masked.mul(guide)) / weight - mean_g.mul(mean_g);
  const cv::Mat covariance = Window(masked.mul(target)) / weight - mean_g.mul(mean_t);
  LocalLine line;
  line.slope = covariance / (variance + kRelativeVariance * mean_g.mul(mean_g) + kTiny);
  // Slopes beyond these come from a few noisy pixels.
  cv::min(line.slope, 4.0, line.slope);
  cv::max(line.slope, -1.0, line.slope);
  line.offset = mean_t - line.slope.mul(mean_g);
  return line;
}

// Green at red's (blue's) pixels: what that colour shows there beyond its four next samples, as much
// of it as green follows, at half weight as in Malvar et al. 2004.
cv::Mat GreenDetail(const cv::Mat& green, const cv::Mat& colour, const cv::Mat& mask) {
  constexpr float kQuarter = .25f;
  const cv::Mat kernel = (cv::Mat_<float>(5, 5) << 0, 0, kQuarter, 0, 0,  //
                          0, 0, 0, 0, 0,                                   //
                          kQuarter, 0, 0, 0, kQuarter,                     //
                          0, 0, 0, 0, 0,                                   //
                          0, 0, kQuarter, 0, 0);
  cv::Mat neighbours, slope = FitLine(colour, green, mask).slope;
  cv::filter2D(colour, neighbours, CV_32F, kernel, cv::Point(-1, -1), 0, cv::BORDER_REFLECT_101);
  cv::max(slope, 0.0, slope);
  cv::min(slope, 2.0, slope);
  return 0.5 * (colour - neighbours).mul(mask).mul(slope);
}

// Residual interpolation (Kiku et al. 2013): the line through green tells the detail, and what the
// colour's own samples say beyond it is interpolated; so samples are kept as they are.
cv::Mat FollowGreen(const cv::Mat& green, const cv::Mat& colour, const cv::Mat& mask) {
  const LocalLine line = FitLine(green, colour, mask);
  const cv::Mat tentative = line.slope.mul(green) + line.offset;
  cv::Mat residual = (colour - tentative).mul(mask);
  Filter(residual, kRedBlue);
  return tentative + residual;
}

std::array<cv::Mat, 3> BayerPlanes(const MosaicImage& mosaic) {
  const cv::Mat red = PlaneOf(mosaic, 0), blue = PlaneOf(mosaic, 2);
  const cv::Mat red_mask = MaskOf(mosaic, 0), blue_mask = MaskOf(mosaic, 2);
  cv::Mat green = PlaneOf(mosaic, 1);
  Filter(green, kGreen);
  const cv::Mat detail =
      GreenDetail(green, red, red_mask) + GreenDetail(green, blue, blue_mask);
  green += detail;
  return {FollowGreen(green, red, red_mask), green, FollowGreen(green, blue, blue_mask)};
}

std::array<cv::Mat, 3> Planes(const MosaicImage& mosaic, PixelModel model) {
  const bool mono = mosaic.pattern == BayerPattern::kMono;
  std::array<cv::Mat, 3> planes;
  if (mono) {
    planes[0] = PlaneOf(mosaic, 1);
  } else {
    planes = BayerPlanes(mosaic);
  }
  for (size_t c = 0; c < (mono ? 1 : 3) && model == PixelModel::kCentre; ++c) {
    Filter(planes[c], kCentreFromMean);
  }
  if (mono) planes[1] = planes[2] = planes[0];  // shared, read only from here on
  return planes;
}

// Marks every pixel whose interpolation took in a saturated one. (Windows of the lines reach
// further; a line that a clipped pixel has bent is not marked.)
std::vector<uint8_t> SpreadSaturated(const MosaicImage& mosaic, PixelModel model) {
  if (mosaic.saturated.empty()) return {};
  const int reach = (mosaic.pattern == BayerPattern::kMono ? 0 : 2) +
                    (model == PixelModel::kCentre ? 1 : 0);
  cv::Mat flags(mosaic.height, mosaic.width, CV_8U,
                const_cast<uint8_t*>(mosaic.saturated.data()));  // only read
  cv::Mat spread;
  cv::dilate(flags, spread, cv::Mat::ones(2 * reach + 1, 2 * reach + 1, CV_8U));
  return {spread.begin<uint8_t>(), spread.end<uint8_t>()};
}

}  // namespace

StatusOr<RgbImage> Demosaic(const MosaicImage& mosaic, PixelModel model) {
  if (mosaic.width < kSmallest || mosaic.height < kSmallest) {
    return InvalidArgument("an image of {} x {} pixels, at least {} x {} are needed", mosaic.width,
                           mosaic.height, kSmallest, kSmallest);
  }
  try {
    RgbImage image{mosaic.width, mosaic.height, {}, {}};
    image.rgb.resize(mosaic.radiance.size() * 3);
    const std::array<cv::Mat, 3> planes = Planes(mosaic, model);
    cv::Mat interleaved(mosaic.height, mosaic.width, CV_32FC3, image.rgb.data());
    cv::merge(planes.data(), planes.size(), interleaved);
    image.saturated = SpreadSaturated(mosaic, model);
    return image;
  } catch (const cv::Exception& error) {
    return Internal("demosaicing {} x {} pixels: {}", mosaic.width, mosaic.height, error.what());
  }
}

}  // namespace mesorig::image
