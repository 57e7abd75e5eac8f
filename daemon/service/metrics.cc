#include "daemon/service/metrics.h"

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/text_serializer.h>

#include <map>
#include <sstream>

#include "protocol/base/process_figures.h"
#include "protocol/base/program.h"

namespace mesorig::daemon {
namespace {

struct Family {
  std::string_view help;
  prometheus::MetricType type = prometheus::MetricType::Gauge;
};

// Every name, with its help.
const std::map<std::string, Family, std::less<>>& Families() {
  constexpr auto kCounter = prometheus::MetricType::Counter;
  constexpr auto kGauge = prometheus::MetricType::Gauge;
  static const std::map<std::string, Family, std::less<>> families = {
      {"mesorig_build_info", {"1; version of mesorigd and name of its rig", kGauge}},
      {"mesorig_state", {"1 for the state that the daemon is in", kGauge}},
      {"mesorig_uptime_seconds", {"since the daemon serves", kGauge}},
      {"mesorig_shots_planned", {"of the session that runs, or ran last", kGauge}},
      {"mesorig_shots_done", {"of them", kGauge}},
      {"mesorig_frames_planned", {"of the session that runs, or ran last", kGauge}},
      {"mesorig_frames_durable", {"of them, on the disk with their ledger rows", kGauge}},
      {"mesorig_frames_queued", {"taken, not durable yet", kGauge}},
      {"mesorig_frames_verified", {"read again at the end of the session", kGauge}},
      {"mesorig_frames_late_total", {"came after their deadline, thrown away", kCounter}},
      {"mesorig_frames_lost_total", {"never came", kCounter}},
      {"mesorig_frames_refused_total", {"torn, stale, duplicated", kCounter}},
      {"mesorig_alarms", {"pictures of this run that somebody should look at", kGauge}},
      {"mesorig_remaining_seconds", {"rig time to go, by the plan's estimate", kGauge}},
      {"mesorig_bytes_left", {"pixels that are still to come", kGauge}},
      {"mesorig_disk_free_bytes", {"of the state folder's file system", kGauge}},
      {"mesorig_disk_refuses", {"1 while the disk takes nothing", kGauge}},
      {"mesorig_waiting_for_operator", {"1 while a prompt is open", kGauge}},
      {"mesorig_event_sequence", {"number of the latest event", kGauge}},
      {"mesorig_consumer_streams", {"open streams of frames, by peer", kGauge}},
      {"mesorig_reading", {"what was last read back from the rig", kGauge}},
      {"mesorig_reading_age_seconds", {"rig time since it was read back", kGauge}},
      {"mesorig_lease_held", {"1 for the kind of lease in force: manual, run", kGauge}},
      {"mesorig_audit_sequence", {"of the audit log's last entry", kGauge}},
      {"mesorig_audit_refuses", {"1 while nothing can be recorded", kGauge}},
      {"mesorig_safety_may_energise", {"1 when light and torque are permitted", kGauge}},
      {"mesorig_safety_tripped", {"1 while a trip is latched", kGauge}},
      {"mesorig_safety_trips_total", {"since the daemon began", kCounter}},
      {"mesorig_safety_stops_total", {"by people, since the daemon began", kCounter}},
      {"mesorig_rig_connected", {"0 when the rig is gone", kGauge}},
      {"mesorig_watchdog_silent_seconds", {"host time that a part owes a sign of life", kGauge}},
      {"mesorig_notifications_total", {"by channel and outcome", kCounter}},
      {"process_cpu_seconds_total", {"user and system time", kCounter}},
      {"process_resident_memory_bytes", {"resident memory", kGauge}},
      {"process_threads", {"threads", kGauge}},
      {"process_open_fds", {"open file descriptors", kGauge}},
      {"process_start_time_seconds", {"since the epoch", kGauge}},
  };
  return families;
}

std::vector<prometheus::MetricFamily> FamiliesOf(const std::vector<Sample>& samples) {
  std::map<std::string, prometheus::MetricFamily> by_name;
  for (const Sample& sample : samples) {
    prometheus::MetricFamily& family = by_name[sample.name];
    const auto known = Families().find(sample.name);
    family.name = sample.name;
    family.type = known == Families().end() ? prometheus::MetricType::Untyped : known->second.type;
    if (known != Families().end()) family.help = known->second.help;
    prometheus::ClientMetric& metric = family.metric.emplace_back();
    for (const auto& [name, value] : sample.labels) metric.label.push_back({name, value});
    metric.gauge.value = metric.counter.value = metric.untyped.value = sample.value;
  }
  std::vector<prometheus::MetricFamily> families;
  for (auto& [name, family] : by_name) families.push_back(std::move(family));
  return families;
}

class Collector final : public prometheus::Collectable {
 public:
  explicit Collector(std::function<std::vector<Sample>()> collect) : collect_(std::move(collect)) {}
  std::vector<prometheus::MetricFamily> Collect() const override { return FamiliesOf(collect_()); }

 private:
  const std::function<std::vector<Sample>()> collect_;
};

class MetricsServerImpl final : public MetricsServer {
 public:
  MetricsServerImpl(int port, std::function<std::vector<Sample>()> collect)
      : collector_(std::make_shared<Collector>(std::move(collect))),
        exposer_({"listening_ports", fmt::format("127.0.0.1:{}", port), "num_threads", "2",
                  "request_timeout_ms", "2000", "linger_timeout_ms", "500"}) {
    exposer_.RegisterCollectable(collector_);
  }
  int port() const override {
    const std::vector<int> ports = exposer_.GetListeningPorts();
    return ports.empty() ? 0 : ports.front();
  }

 private:
  const std::shared_ptr<Collector> collector_;  // as the library asks: it holds a weak one
  prometheus::Exposer exposer_;
};

void AddStates(const v1::StatusReply& status, std::vector<Sample>& samples) {
  const auto* states = v1::State_descriptor();
  for (int i = 0; i < states->value_count(); ++i) {
    const int number = states->value(i)->number();
    if (number == v1::STATE_UNSPECIFIED) continue;
    std::string name = states->value(i)->name();
    for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    samples.push_back({"mesorig_state", {{"state", name}}, status.state() == number ? 1.0 : 0.0});
  }
}

void AddProcess(std::vector<Sample>& samples) {
  const ProcessFigures figures = ReadProcessFigures();
  samples.push_back({"process_cpu_seconds_total", {}, figures.cpu_s});
  samples.push_back(
      {"process_resident_memory_bytes", {}, static_cast<double>(figures.resident_bytes)});
  samples.push_back({"process_threads", {}, static_cast<double>(figures.threads)});
  samples.push_back({"process_open_fds", {}, static_cast<double>(figures.open_files)});
  samples.push_back({"process_start_time_seconds", {}, figures.started_s});
}

}  // namespace

std::vector<Sample> SamplesOf(const v1::StatusReply& status, const std::string& rig_name) {
  std::vector<Sample> samples;
  const auto add = [&](const char* name, auto value) {
    samples.push_back({name, {}, static_cast<double>(value)});
  };
  samples.push_back(
      {"mesorig_build_info", {{"version", std::string(kVersion)}, {"rig", rig_name}}, 1});
  AddStates(status, samples);
  add("mesorig_uptime_seconds", status.uptime_s());
  add("mesorig_shots_planned", status.shots());
  add("mesorig_shots_done", status.shots_done());
  add("mesorig_frames_planned", status.frames());
  add("mesorig_frames_durable", status.frames_durable());
  add("mesorig_frames_queued", status.frames_queued());
  add("mesorig_frames_verified", status.frames_verified());
  add("mesorig_frames_late_total", status.frames_late());
  add("mesorig_frames_lost_total", status.frames_lost());
  add("mesorig_frames_refused_total", status.frames_refused());
  add("mesorig_alarms", status.alarms());
  add("mesorig_remaining_seconds", status.remaining_s());
  add("mesorig_bytes_left", status.bytes_left());
  add("mesorig_disk_free_bytes", status.disk_free_bytes());
  add("mesorig_disk_refuses", !status.storage().empty());
  add("mesorig_waiting_for_operator", status.has_prompt());
  add("mesorig_event_sequence", status.event_sequence());
  samples.push_back({"mesorig_lease_held",
                     {{"kind", "manual"}},
                     status.lease().kind() == v1::LEASE_MANUAL ? 1.0 : 0.0});
  samples.push_back(
      {"mesorig_lease_held", {{"kind", "run"}}, status.lease().kind() == v1::LEASE_RUN ? 1.0 : 0.0});
  add("mesorig_audit_sequence", status.audit_sequence());
  add("mesorig_audit_refuses", !status.audit_trouble().empty());
  for (const v1::Consumer& consumer : status.consumers()) {
    samples.push_back({"mesorig_consumer_streams",
                       {{"peer", consumer.peer()}},
                       static_cast<double>(consumer.streams())});
  }
  for (const v1::Reading& reading : status.readings()) {
    samples.push_back({"mesorig_reading",
                       {{"name", reading.name()}, {"unit", reading.unit()}},
                       reading.value()});
    samples.push_back(
        {"mesorig_reading_age_seconds", {{"name", reading.name()}}, reading.age_s()});
  }
  AddProcess(samples);
  return samples;
}

std::string MetricsText(const std::vector<Sample>& samples) {
  std::ostringstream text;
  prometheus::TextSerializer().Serialize(text, FamiliesOf(samples));
  return text.str();
}

StatusOr<std::unique_ptr<MetricsServer>> MetricsServer::Start(
    int port, std::function<std::vector<Sample>()> collect) {
  try {
    return std::make_unique<MetricsServerImpl>(port, std::move(collect));
  } catch (const std::exception& error) {
    return FailedPrecondition("metrics: 127.0.0.1:{} cannot be had ({})", port, error.what());
  }
}

}  // namespace mesorig::daemon
