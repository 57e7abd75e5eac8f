#include "daemon/control/picture.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace mesorig::daemon {
namespace {

constexpr double kNoiseSigmas = 3;
constexpr double kPixelsLookedAt = 16384;
constexpr size_t kFramesRemembered = 15;

struct Raw {
  const unsigned char* bytes;
  int width, bytes_per_pixel;
  int At(int x, int y) const {
    const size_t i = static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
    return bytes_per_pixel == 1 ? bytes[i] : bytes[2 * i] | bytes[2 * i + 1] << 8;
  }
};

double DarkLimit(const mesorig::Camera& camera) {
  const double dn_per_electron =
      camera.full_well_e > 0 ? (camera.white_dn() - camera.black_dn) / camera.full_well_e : 0;
  return camera.black_dn + std::max(1.0, kNoiseSigmas * camera.read_noise_e * dn_per_electron);
}

}  // namespace

int StrideFor(int width, int height) {
  const double pixels = static_cast<double>(width) * height;
  return std::max(1, static_cast<int>(std::floor(std::sqrt(pixels / kPixelsLookedAt))));
}

PictureFigures MeasurePicture(const mesorig::Camera& camera, int width, int height,
                              std::string_view pixels, int stride) {
  PictureFigures figures;
  const Raw raw{reinterpret_cast<const unsigned char*>(pixels.data()), width,
                camera.bytes_per_pixel()};
  const size_t needed = static_cast<size_t>(std::max(width, 0)) *
                        static_cast<size_t>(std::max(height, 0)) *
                        static_cast<size_t>(camera.bytes_per_pixel());
  if (needed == 0 || pixels.size() < needed) return figures;
  const double dark = DarkLimit(camera);
  const int white = camera.white_dn(), black = camera.black_dn;
  // Neighbours of one colour are a cell (two pixels) apart.
  const int cell = 2 * std::max(stride, 1);
  double gradient = 0, signal = 0;
  for (int y = 0; y < height; y += cell) {
    for (int x = 0; x < width; x += cell) {
      for (int k = 0; k < 4; ++k) {
        const int px = x + k % 2, py = y + k / 2;
        if (px >= width || py >= height) continue;
        const int value = raw.At(px, py);
        ++figures.pixels;
        figures.saturated += value >= white;
        figures.dark += value <= dark;
        if (px + 2 >= width || py + 2 >= height) continue;
        const double dx = raw.At(px + 2, py) - value, dy = raw.At(px, py + 2) - value;
        gradient += dx * dx + dy * dy;
        signal += static_cast<double>(value - black) * (value - black);
      }
    }
  }
  figures.sharpness = signal > 0 ? gradient / signal : 0;
  return figures;
}

StatusOr<double> RelativeDifference(const mesorig::Camera& camera, std::string_view reference,
                                    std::string_view again) {
  const auto bytes = static_cast<size_t>(camera.bytes_per_pixel());
  if (reference.size() != again.size() || reference.empty() || reference.size() % bytes != 0) {
    return InvalidArgument("camera {}: the reference frame has {} bytes, the new one {}",
                           camera.name, reference.size(), again.size());
  }
  const auto* a = reinterpret_cast<const unsigned char*>(reference.data());
  const auto* b = reinterpret_cast<const unsigned char*>(again.data());
  double difference = 0, signal = 0;
  for (size_t i = 0; i < reference.size(); i += bytes) {
    const int first = bytes == 1 ? a[i] : a[i] | a[i + 1] << 8;
    const int second = bytes == 1 ? b[i] : b[i] | b[i + 1] << 8;
    difference += std::abs(first - second);
    signal += first - camera.black_dn;
  }
  if (difference == 0) return 0.0;
  // A reference without light: any code value is as much as there is.
  const double floor = static_cast<double>(reference.size() / bytes);
  return difference / std::max(signal, floor);
}

bool PictureAlarms::IsNew(int camera, Kind kind, bool bad) {
  bool& raised = raised_[{camera, kind}];
  const bool is_new = bad && !raised;
  raised = bad;
  return is_new;
}

double PictureAlarms::Median(const std::deque<double>& values) {
  std::vector<double> sorted(values.begin(), values.end());
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

std::vector<std::string> PictureAlarms::Judge(int camera, const std::string& camera_name, int lamp,
                                              const PictureFigures& figures) {
  std::vector<std::string> alarms;
  if (IsNew(camera, kSaturated, figures.saturated_fraction() > limits_.saturated_fraction)) {
    alarms.push_back(fmt::format("camera {}: {:.1f} % of the pixels are saturated (limit {:.1f} %)",
                                 camera_name, 100 * figures.saturated_fraction(),
                                 100 * limits_.saturated_fraction));
  }
  if (IsNew(camera, kDark, figures.dark_fraction() > limits_.dark_fraction)) {
    alarms.push_back(fmt::format("camera {}: {:.1f} % of the pixels are dark (limit {:.1f} %)",
                                 camera_name, 100 * figures.dark_fraction(),
                                 100 * limits_.dark_fraction));
  }
  std::deque<double>& history = sharpness_[{camera, lamp}];
  const bool known = history.size() >= limits_.frames_for_median;
  const double median = known ? Median(history) : 0;
  const bool blurred = known && figures.sharpness < limits_.sharpness_of_median * median;
  if (IsNew(camera, kBlurred, blurred)) {
    alarms.push_back(fmt::format("camera {}: blurred: sharpness {:.3g}, {:.3g} is usual",
                                 camera_name, figures.sharpness, median));
  }
  history.push_back(figures.sharpness);
  if (history.size() > kFramesRemembered) history.pop_front();
  return alarms;
}

}  // namespace mesorig::daemon
