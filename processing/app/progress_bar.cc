#include "processing/app/progress_bar.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace mesorig::processing {
namespace {

constexpr int kWidth = 40;
constexpr double kPatienceS = 2;

}  // namespace

ProgressBar::ProgressBar(std::string what)
    : what_(std::move(what)), terminal_(::isatty(STDERR_FILENO) != 0),
      start_(std::chrono::steady_clock::now()) {}

ProgressBar::~ProgressBar() {
  if (shown_) fmt::print(stderr, "\r\033[K");
}

void ProgressBar::Show(double fraction) {
  const double elapsed_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  fraction = std::clamp(fraction, 0.0, 1.0);
  // Two seconds in all, as far as can be told now.
  if (!terminal_ || fraction <= 0 || (!shown_ && elapsed_s / fraction < kPatienceS)) return;
  const int filled = static_cast<int>(fraction * kWidth);
  fmt::print(stderr, "\r{} [{}{}] {:3.0f} %", what_, std::string(static_cast<size_t>(filled), '#'),
             std::string(static_cast<size_t>(kWidth - filled), '.'), 100 * fraction);
  std::fflush(stderr);
  shown_ = true;
}

}  // namespace mesorig::processing
