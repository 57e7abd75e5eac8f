#pragma once
// How long each lamp has burnt, over all its sessions, in a text file of two columns parted by a
// tab, `NAME HOURS`, after a first line that names them. A new bulb: the line is set to 0 by hand
// while the daemon is down.

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// Thread-safe; takes only its own lock. A thread of its own writes the file every kWrite of host
// time while a lamp burns or has burnt, and at the end: a kill costs that much at most. Counting
// itself never waits for the disk.
class LampHours {
 public:
  static constexpr std::chrono::seconds kWrite{60};

  explicit LampHours(const Rig& rig);  // borrowed
  ~LampHours();

  // Reads the file, when there is one, and keeps it from now on. InvalidArgument names file, line
  // and value; Unavailable: it cannot be read.
  Status Keep(const std::filesystem::path& file);
  // This lamp burns from now on, alone; -1: none.
  void Burn(int lamp, RigTime now);
  std::vector<double> Hours(RigTime now) const;  // per Rig::lamps
  // "lamp L0 has burnt 1020.0 h of the 1000 h that it is rated for": one a lamp; empty without the
  // rig file's rated_hours.
  std::vector<std::string> Overdue(RigTime now) const;

 private:
  Status Read(const std::filesystem::path& file);
  void WriteLoop();
  std::vector<double> HoursLocked(RigTime now) const;

  const Rig& rig_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<double> hours_;
  int burning_ = -1;
  RigTime since_{};
  bool changed_ = false, ending_ = false;
  std::filesystem::path file_;
  std::vector<std::string> others_;  // lines of lamps that this rig has not
  std::thread thread_;
};

}  // namespace mesorig::daemon
