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

std::array<cv::Mat, 3> Planes(const MosaicImage& mosaic, PixelModel model) {
  std::array<cv::Mat, 3> planes;
  if (mosaic.pattern == BayerPattern::kMono) {
    planes[0] = PlaneOf(mosaic, 1);
    if (model == PixelModel::kCentre) Filter(planes[0], kCentreFromMean);
    planes[1] = planes[2] = planes[0];  // shared, read only from here on
    return planes;
  }
  for (size_t c = 0; c < 3; ++c) {
    planes[c] = PlaneOf(mosaic, static_cast<int>(c));
    Filter(planes[c], c == 1 ? kGreen : kRedBlue);
    if (model == PixelModel::kCentre) Filter(planes[c], kCentreFromMean);
  }
  return planes;
}

// Marks every pixel that one of the filters above reached from a saturated one.
std::vector<uint8_t> SpreadSaturated(const MosaicImage& mosaic, PixelModel model) {
  if (mosaic.saturated.empty()) return {};
  const int reach = (mosaic.pattern == BayerPattern::kMono ? 0 : 1) +
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
