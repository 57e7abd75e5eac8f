#pragma once
// How long each lamp has burnt, over all its sessions, in a text file of two columns parted by a
// tab, `NAME HOURS`, after a first line that names them. A new bulb: the line is set to 0 by hand
// while the daemon is down.

#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "protocol/base/clocks.h"
#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/rig/rig.h"

namespace mesorig::daemon {

// Thread-safe; takes only its own lock. A thread of its own writes the file when kWrite of burning
// (rig time) is not in it, or kWriteHost after a change, and at the end. Counting itself never waits
// for the disk: a kill costs kWrite of burning, and what burns while the disk takes a write: 60 s
// at most on a disk that takes it within 30 s.
class LampHours {
 public:
  static constexpr RigTime kWrite = std::chrono::seconds(30);
  static constexpr std::chrono::seconds kWriteHost{60};

  explicit LampHours(const Rig& rig);  // borrowed
  ~LampHours();

  // Reads the file, when there is one, and keeps it from now on. InvalidArgument names file, line
  // and value, Unavailable: it cannot be read; then it is left as it is, and nothing is counted on.
  Status Keep(const std::filesystem::path& file);
  // This lamp burns from now on, alone; -1: none.
  void Burn(int lamp, RigTime now);
  // Time has passed: to be called every second or more often.
  void Tick(RigTime now);
  std::vector<double> Hours(RigTime now) const;  // per Rig::lamps
  // Counted, and not in the file.
  double Unwritten_s() const;
  // "lamp L0 has burnt 1020.0 h of the 1000 h that it is rated for": one a lamp; empty without the
  // rig file's rated_hours.
  std::vector<std::string> Overdue(RigTime now) const;

 private:
  struct Stored {
    std::vector<double> hours;
    std::vector<std::string> others;
  };
  StatusOr<Stored> Read(const std::filesystem::path& file) const;
  void WriteLoop();
  std::string TextLocked(const std::vector<double>& hours) const REQUIRES(mutex_);
  std::vector<double> HoursLocked(RigTime now) const REQUIRES(mutex_);
  double UnwrittenLocked() const REQUIRES(mutex_);  // s, as far as Tick and Burn told

  const Rig& rig_;
  mutable Mutex mutex_;
  CondVar wake_;
  std::vector<double> hours_ GUARDED_BY(mutex_);
  int burning_ GUARDED_BY(mutex_) = -1;
  RigTime since_ GUARDED_BY(mutex_){};   // of the lamp that burns
  RigTime latest_ GUARDED_BY(mutex_){};  // the last Tick or Burn
  double written_h_ GUARDED_BY(mutex_) = 0;  // of all lamps together, in the file
  bool due_ GUARDED_BY(mutex_) = false, ending_ GUARDED_BY(mutex_) = false;
  std::filesystem::path file_;
  std::vector<std::string> others_ GUARDED_BY(mutex_);  // lines of lamps that this rig has not
  std::thread thread_;
};

}  // namespace mesorig::daemon
