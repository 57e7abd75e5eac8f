#pragma once
// The daemon's figures for Prometheus, at http://127.0.0.1:PORT/metrics: on loopback only, for
// anybody on this machine, made anew for each scrape. docs/operations.md lists them.

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/messages/control.pb.h"

namespace mesorig::daemon {

// One sample: name{label="value"} number.
struct Sample {
  std::string name;
  std::vector<std::pair<std::string, std::string>> labels;
  double value = 0;
};

// What a status tells, and what this process takes of the machine.
std::vector<Sample> SamplesOf(const v1::StatusReply& status, const std::string& rig_name);

// The text format 0.0.4 of Prometheus, families in order of name.
std::string MetricsText(const std::vector<Sample>& samples);

class MetricsServer {
 public:
  // port 0: any free one. `collect` is called for each scrape, on a thread of the server; it must
  // not wait for the rig. FailedPrecondition when the port cannot be had.
  static StatusOr<std::unique_ptr<MetricsServer>> Start(
      int port, std::function<std::vector<Sample>()> collect);
  virtual ~MetricsServer() = default;  // ends the scrapes under way
  virtual int port() const = 0;
};

}  // namespace mesorig::daemon
