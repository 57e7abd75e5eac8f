#include "protocol/base/process_figures.h"

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace mesorig {
namespace {

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

// Time since boot at which the process began, by /proc/self/stat (proc(5), field 22).
double StartedSinceBoot() {
  std::ifstream file("/proc/self/stat");
  std::string text((std::istreambuf_iterator<char>(file)), {});
  const size_t name_end = text.rfind(')');  // the name may hold anything
  if (name_end == text.npos) return 0;
  std::istringstream fields(text.substr(name_end + 1));
  std::string field;
  for (int i = 3; i <= 22 && fields >> field; ++i) continue;
  return std::strtod(field.c_str(), nullptr) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

}  // namespace

ProcessFigures ReadProcessFigures() {
  ProcessFigures figures;
  rusage usage{};
  if (::getrusage(RUSAGE_SELF, &usage) == 0) {
    figures.cpu_s = Seconds(usage.ru_utime) + Seconds(usage.ru_stime);
  }
  std::ifstream memory("/proc/self/statm");
  uint64_t pages = 0, resident = 0;
  if (memory >> pages >> resident) {
    figures.resident_bytes = resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
  }
  const auto count = [](const char* folder) {
    std::error_code error;
    uint32_t entries = 0;
    for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      ++entries;
    }
    return entries;
  };
  figures.threads = count("/proc/self/task");
  figures.open_files = count("/proc/self/fd");
  if (figures.open_files > 0) --figures.open_files;  // the one that looked
  timespec up{};
  if (::clock_gettime(CLOCK_BOOTTIME, &up) == 0) {
    const double up_s = static_cast<double>(up.tv_sec) + 1e-9 * static_cast<double>(up.tv_nsec);
    const double now_s = std::chrono::duration<double>(
                             std::chrono::system_clock::now().time_since_epoch()).count();
    figures.started_s = now_s - up_s + StartedSinceBoot();
  }
  return figures;
}

}  // namespace mesorig
