#pragma once
// What really happened at the rig, for people and tests: one line an event, three columns parted by
// tabs after a first line that names them:
//
//   time_s       of the rig, nine decimals, never going back
//   what         laser | lamp NAME | torque AXIS | axis NAME | contactor | mount | motor | injected
//   event        on, off | moves, stands | closed, open | NAME | run N %, brake, coast | a fault's or
//                hand's words (simulator/devices/README.md)
//
// The first lines, at time 0, say how everything begins. Each line is flushed. Called by the
// dispatcher only.

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string_view>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"

namespace mesorig::simulator {

class RigLog {
 public:
  // Overwrites the file. Unavailable when it cannot be opened.
  static StatusOr<std::unique_ptr<RigLog>> Create(const std::filesystem::path& path);
  // A line that cannot be written is reported once, by the program's own log.
  void Write(RigTime now, std::string_view what, std::string_view event);

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  RigLog(std::FILE* file, std::filesystem::path path) : file_(file), path_(std::move(path)) {}
  std::unique_ptr<std::FILE, Close> file_;
  std::filesystem::path path_;
  bool failed_ = false;
};

}  // namespace mesorig::simulator
