#include "daemon/app/supervision.h"

#include <fmt/ranges.h>

#include "daemon/safety/safety.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/process_figures.h"
#include "protocol/base/program.h"

namespace mesorig::daemon {
namespace {

using HostClock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kLookEvery{500};
constexpr std::string_view kMetricsFile = "mesorigd-metrics.endpoint";

std::string StatusLine(const v1::StatusReply& status) {
  std::string state = v1::State_Name(status.state());
  for (char& c : state) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (status.state() == v1::IDLE) return state;
  std::string line = state;
  if (!status.session_id().empty()) {
    line += fmt::format(", session {}: {} of {} shots", status.session_id(), status.shots_done(),
                        status.shots());
  }
  if (!status.message().empty()) line += fmt::format(", {}", status.message());
  return line;
}

std::string Lines(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line;
  return text;
}

}  // namespace

Supervision::Supervision(const Settings& settings, const Rig& rig, AttachedRig& devices,
                         DaemonService& service, Access& access,
                         const ServiceManager& manager)
    : rig_(rig),
      devices_(devices),
      service_(service),
      access_(access),
      manager_(manager),
      watchdog_(manager, Sources()),
      settings_(settings),
      verified_at_(HostClock::now()) {}

StatusOr<std::unique_ptr<Supervision>> Supervision::Start(const Settings& settings, const Rig& rig,
                                                          AttachedRig& devices,
                                                          DaemonService& service,
                                                          Access& access,
                                                          const ServiceManager& manager) {
  std::unique_ptr<Supervision> supervision(
      new Supervision(settings, rig, devices, service, access, manager));
  const std::filesystem::path published =
      std::filesystem::path(settings.runtime_dir) / kMetricsFile;
  std::error_code ignored;
  std::filesystem::remove(published, ignored);  // of an earlier life
  if (settings.metrics_port) {
    MESORIG_ASSIGN_OR_RETURN(
        supervision->metrics_,
        MetricsServer::Start(*settings.metrics_port,
                             [raw = supervision.get()] { return raw->Samples(); }));
    const std::string url =
        fmt::format("http://127.0.0.1:{}/metrics", supervision->metrics_->port());
    MESORIG_RETURN_IF_ERROR(WriteFileAtomically(published, url));
    Log("metrics").info("at {}", url);
  }
  supervision->StartNotifiers(settings.notify);
  service.OnDiagnose([raw = supervision.get()] { return raw->Diagnose(); });
  return supervision;
}

Supervision::~Supervision() {
  service_.OnDiagnose(nullptr);
  metrics_.reset();  // its threads call Samples
  std::error_code ignored;
  std::vector<std::unique_ptr<Notifier>> notifiers;
  {
    MutexLock lock(mutex_);
    std::filesystem::remove(std::filesystem::path(settings_.runtime_dir) / kMetricsFile, ignored);
    notifiers.swap(notifiers_);
  }
}

std::vector<ProgressSource> Supervision::Sources() {
  std::vector<ProgressSource> sources = {{"rig", [this] { return RigSilence(); }}};
  if (Safety* safety = devices_.sequencer().safety()) {
    // It knows how long its threads may take (docs/safety.md): what it calls a hang is one.
    sources.push_back({"safety", [safety]() -> std::chrono::nanoseconds {
                         return safety->Health().ok() ? std::chrono::hours(0)
                                                      : std::chrono::hours(1);
                       }});
  }
  return sources;
}

std::chrono::nanoseconds Supervision::RigSilence() {
  // A rig thread that waits for its clock makes progress; one that runs (computes, waits for a lock
  // or a disk) must come back to it. Reading a session again at its end takes minutes, and shows.
  std::chrono::nanoseconds longest{};
  for (const RigClock::Runner& runner : devices_.Runners()) {
    longest = std::max(longest, runner.running);
  }
  const uint64_t verified = devices_.sequencer().GetStatus().frames_verified;
  const auto now = HostClock::now();
  MutexLock lock(mutex_);
  if (verified != verified_) {
    verified_ = verified;
    verified_at_ = now;
  }
  return std::min<std::chrono::nanoseconds>(longest, now - verified_at_);
}

void Supervision::StartNotifiers(const NotifierOptions& options) {
  std::vector<std::unique_ptr<Notifier>> notifiers;
  const auto add = [&](Notifier::Channel channel) {
    notifiers.push_back(
        std::make_unique<Notifier>(service_.events(), rig_.name, options, channel));
  };
  if (!options.command.empty()) add(Notifier::Channel::kCommand);
  if (!options.webhook.empty()) add(Notifier::Channel::kWebhook);
  {
    MutexLock lock(mutex_);
    notifiers_.swap(notifiers);
  }
  // (Those before end here, without the lock.)
}

void Supervision::Look() {
  const auto now = HostClock::now();
  if (looked_ && now - *looked_ < kLookEvery) return;
  looked_ = now;
  const v1::StatusReply status = service_.Status();
  const std::string silent = watchdog_.Look(now);
  const bool healthy = silent.empty() && status.state() != v1::FAULT;
  // Sessions are read whatever the rig does.
  access_.SetServing("", healthy);
  access_.SetServing("mesorig.v1.Control", healthy);
  access_.SetServing("mesorig.v1.Frames", true);
  access_.SetServing("mesorig.v1.Operations", true);
  std::string line =
      silent.empty() ? StatusLine(status) : fmt::format("{} makes no progress", silent);
  if (line == told_) return;
  told_ = std::move(line);
  if (const Status said = manager_.Say(told_); !said.ok()) {
    Log("program").debug("systemd: {}", Message(said));
  }
}

void Supervision::Reload(const Settings& wanted) {
  bool notify = false;
  std::vector<std::string> stuck;
  {
    MutexLock lock(mutex_);
    stuck = NeedRestart(settings_, wanted);
    const NotifierOptions &a = settings_.notify, &b = wanted.notify;
    notify = a.command != b.command || a.webhook != b.webhook || a.headers != b.headers ||
             a.on != b.on || a.limit != b.limit;
    settings_.log = wanted.log;
    settings_.notify = wanted.notify;
  }
  if (const Status status = SetLogging(wanted.log); !status.ok()) {
    Log("program").error("{}", Message(status));
  }
  if (notify) StartNotifiers(wanted.notify);
  if (!access_.address().empty()) access_.Reload();
  Log("program").info("reloaded: log levels and format, allowed certificates{}", notify ? ", notifications" : "");
  if (!stuck.empty()) {
    Log("program").warn("{} changed: needs a restart of mesorigd", fmt::join(stuck, ", "));
  }
}

std::vector<Sample> Supervision::Samples() {
  std::vector<Sample> samples = SamplesOf(service_.Status(), rig_.name);
  samples.push_back({"mesorig_rig_connected", {}, devices_.health().ok() ? 1.0 : 0.0});
  if (Safety* safety = devices_.sequencer().safety()) {
    const SafetyState state = safety->state();
    samples.push_back({"mesorig_safety_may_energise", {}, state.may_energise ? 1.0 : 0.0});
    samples.push_back({"mesorig_safety_tripped", {}, state.tripped ? 1.0 : 0.0});
    samples.push_back({"mesorig_safety_trips_total", {}, static_cast<double>(state.trips)});
    samples.push_back({"mesorig_safety_stops_total", {}, static_cast<double>(state.stops)});
  }
  for (const Watchdog::Silence& source : watchdog_.Silences()) {
    samples.push_back({"mesorig_watchdog_silent_seconds",
                       {{"source", source.name}},
                       std::chrono::duration<double>(source.silent).count()});
  }
  MutexLock lock(mutex_);
  for (const auto& notifier : notifiers_) {
    const Notifier::Figures figures = notifier->figures();
    const std::string channel(Notifier::Name(notifier->channel()));
    const auto add = [&](const char* outcome, uint64_t value) {
      samples.push_back({"mesorig_notifications_total",
                         {{"channel", channel}, {"outcome", outcome}},
                         static_cast<double>(value)});
    };
    add("sent", figures.sent);
    add("failed", figures.failed);
  }
  return samples;
}

std::vector<DiagnosticFile> Supervision::Diagnose() {
  Settings settings;
  {
    MutexLock lock(mutex_);
    settings = settings_;
  }
  const ProcessFigures process = ReadProcessFigures();
  std::vector<DiagnosticFile> files = {
      {"version.txt", fmt::format("mesorigd {}\nrig {} sha256 {}\n", kVersion, rig_.name,
                                  rig_.sha256)},
      {"process.txt", fmt::format("cpu {:.2f} s\nresident {} bytes\nthreads {}\nopen files {}\n",
                                  process.cpu_s, process.resident_bytes, process.threads,
                                  process.open_files)},
      {"mesorigd.toml", SettingsText(settings)},
      {"rig.toml", rig_.source_text},
      {"metrics.txt", MetricsText(Samples())},
      {"log.txt", Lines(RecentLog())},
  };
  const std::vector<std::string> secrets = SecretsOf(settings);
  for (DiagnosticFile& file : files) file.content = WithoutSecrets(file.content, secrets);
  return files;
}

}  // namespace mesorig::daemon
