#pragma once
// A laboratory's life at the daemon, in virtual time: sessions one after the other with random
// faults, stops, pauses, lease changes and consumers that come and go, by a fixed seed. The
// simulator's devices in this process with a cheap image source, the real drivers, sequencer,
// sessions on disk, lease and audit log.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/process_figures.h"

namespace mesorig::daemon {

struct SoakOptions {
  double virtual_s = 86400;
  double cycle_s = 600;  // from the beginning of a session to that of the next
  uint32_t seed = 20240611;
};

struct SoakReport {
  double virtual_s = 0, host_s = 0, cpu_s = 0;
  uint32_t sessions = 0, complete = 0, incomplete = 0, refused = 0, resumed = 0;
  uint32_t injections = 0, stops = 0, pauses = 0, aborts = 0, recoveries = 0;
  uint32_t lease_changes = 0, consumer_restarts = 0;
  uint64_t frames_acknowledged = 0, frames_read = 0, audit_entries = 0;
  // A complete session's pixels depend on where the axes really stood and on what really shone: that
  // all are equal, byte for byte, is that nothing drifted.
  uint32_t equal_sessions = 0;
  double worst_position_error_rad = 0;  // at the end of complete sessions: drive against world
  // After each session; the first quarter fills caches.
  std::vector<ProcessFigures> samples;
  std::vector<std::string> violations;  // of what must always hold

  const ProcessFigures& settled() const { return samples.at(samples.size() / 4); }
  const ProcessFigures& last() const { return samples.back(); }
  std::string Text() const;  // a table of the above
  std::string Json() const;
};

// `root`: sessions, lease and audit log go there. Ends at the first hang (a violation).
SoakReport RunSoak(const std::filesystem::path& root, const SoakOptions& options);

}  // namespace mesorig::daemon
