#include "simulator/devices/rig_log.h"

#include <cerrno>
#include <cstring>

#include "protocol/base/log.h"

namespace mesorig::simulator {

StatusOr<std::unique_ptr<RigLog>> RigLog::Create(const std::filesystem::path& path) {
  std::FILE* file = std::fopen(path.c_str(), "we");
  if (file == nullptr) return Unavailable("{}: {}", path.string(), strerror(errno));
  std::unique_ptr<RigLog> log(new RigLog(file, path));
  fmt::print(file, "time_s\twhat\tevent\n");
  return log;
}

void RigLog::Write(RigTime now, std::string_view what, std::string_view event) {
  const std::string line = fmt::format("{}.{:09}\t{}\t{}\n", now.count() / 1'000'000'000,
                                       now.count() % 1'000'000'000, what, event);
  const bool written = std::fwrite(line.data(), 1, line.size(), file_.get()) == line.size() &&
                       std::fflush(file_.get()) == 0;
  if (!written && !failed_) {
    failed_ = true;
    spdlog::error("{}: {}; the log is not complete", path_.string(), strerror(errno));
  }
}

}  // namespace mesorig::simulator
