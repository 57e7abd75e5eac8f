#pragma once
// A bar on standard error, on a terminal only, for what takes more than two seconds.

#include <chrono>
#include <string>

namespace mesorig::processing {

// One thread. The destructor clears the bar.
class ProgressBar {
 public:
  explicit ProgressBar(std::string what);
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  ~ProgressBar();
  void Show(double fraction);

 private:
  std::string what_;
  bool terminal_, shown_ = false;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace mesorig::processing
