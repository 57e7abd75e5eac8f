#include "daemon/safety/lamp_hours.h"

#include <charconv>
#include <numeric>
#include <set>

#include "protocol/base/file_writer.h"
#include "protocol/base/log.h"

namespace mesorig::daemon {
namespace {

constexpr std::string_view kHeader = "lamp\thours";
constexpr double kMostHours = 1e7;
using HostClock = std::chrono::steady_clock;

double Sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

}  // namespace

LampHours::LampHours(const Rig& rig) : rig_(rig), hours_(rig.lamps.size()) {}

LampHours::~LampHours() {
  {
    const MutexLock lock(mutex_);
    ending_ = true;
    wake_.NotifyAll();
  }
  if (thread_.joinable()) thread_.join();
}

Status LampHours::Keep(const std::filesystem::path& file) {
  if (thread_.joinable()) return FailedPrecondition("lamp-hours are kept in {}", file_.string());
  if (std::filesystem::exists(file)) {
    MESORIG_ASSIGN_OR_RETURN(Stored stored, Read(file));
    const MutexLock lock(mutex_);
    // (What has burnt already is not in the file.)
    written_h_ = Sum(stored.hours);
    for (size_t i = 0; i < hours_.size(); ++i) hours_[i] += stored.hours[i];
    others_ = std::move(stored.others);
  }
  std::error_code ignored;  // writing says what is wrong
  std::filesystem::create_directories(file.parent_path(), ignored);
  file_ = file;
  thread_ = std::thread([this] { WriteLoop(); });
  return OkStatus();
}

StatusOr<LampHours::Stored> LampHours::Read(const std::filesystem::path& file) const {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(file, 1u << 20));
  Stored stored{std::vector<double>(rig_.lamps.size()), {}};
  std::set<std::string> seen;
  int number = 0;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size());
    const std::string line = text.substr(at, end - at);
    at = end + 1;
    if (++number == 1 && line != kHeader) {
      return InvalidArgument("{}:1: is \"{}\", not \"lamp<tab>hours\"", file.string(), line);
    }
    if (number == 1 || line.empty()) continue;
    const size_t tab = line.find('\t');
    const std::string_view value =
        tab == line.npos ? std::string_view() : std::string_view(line).substr(tab + 1);
    double hours = 0;
    const auto [stop, error] = std::from_chars(value.data(), value.data() + value.size(), hours);
    if (value.empty() || error != std::errc() || stop != value.data() + value.size() ||
        !(hours >= 0 && hours <= kMostHours)) {
      return InvalidArgument("{}:{}: \"{}\" is not LAMP<tab>HOURS with hours in [0, {:g}]",
                             file.string(), number, line, kMostHours);
    }
    const std::string name = line.substr(0, tab);
    if (!seen.insert(name).second) {
      return InvalidArgument("{}:{}: lamp \"{}\" is there twice", file.string(), number, name);
    }
    const auto lamp = rig_.FindLamp(name);
    if (lamp) {
      stored.hours[static_cast<size_t>(*lamp)] = hours;
    } else {
      stored.others.push_back(line);
    }
  }
  if (number == 0) return InvalidArgument("{}: is empty", file.string());
  for (const Lamp& lamp : rig_.lamps) {
    if (seen.contains(lamp.name)) continue;
    Log("safety").warn("{}: lamp {} is not there: counted from 0", file.string(), lamp.name);
  }
  return stored;
}

std::vector<double> LampHours::HoursLocked(RigTime now) const {
  std::vector<double> hours = hours_;
  if (burning_ >= 0) {
    hours[static_cast<size_t>(burning_)] += Seconds(std::max(now, since_) - since_) / 3600;
  }
  return hours;
}

double LampHours::UnwrittenLocked() const {
  return 3600 * (Sum(HoursLocked(latest_)) - written_h_);
}

double LampHours::Unwritten_s() const {
  const MutexLock lock(mutex_);
  return UnwrittenLocked();
}

void LampHours::Burn(int lamp, RigTime now) {
  const MutexLock lock(mutex_);
  hours_ = HoursLocked(now);
  burning_ = lamp;
  since_ = latest_ = now;
}

void LampHours::Tick(RigTime now) {
  const MutexLock lock(mutex_);
  latest_ = std::max(latest_, now);
  if (due_ || UnwrittenLocked() < Seconds(kWrite)) return;
  due_ = true;
  wake_.NotifyAll();
}

std::vector<double> LampHours::Hours(RigTime now) const {
  const MutexLock lock(mutex_);
  return HoursLocked(now);
}

std::vector<std::string> LampHours::Overdue(RigTime now) const {
  std::vector<std::string> overdue;
  const double rated = rig_.lamp_bank.rated_hours;
  const std::vector<double> hours = Hours(now);
  for (size_t i = 0; i < hours.size() && rated > 0; ++i) {
    if (hours[i] <= rated) continue;
    overdue.push_back(fmt::format("lamp {} has burnt {:.1f} h of the {:g} h that it is rated for",
                                  rig_.lamps[i].name, hours[i], rated));
  }
  return overdue;
}

std::string LampHours::TextLocked(const std::vector<double>& hours) const {
  std::string text = std::string(kHeader) + "\n";
  for (size_t i = 0; i < hours.size(); ++i) {
    text += fmt::format("{}\t{:.6f}\n", rig_.lamps[i].name, hours[i]);
  }
  for (const std::string& other : others_) text += other + "\n";
  return text;
}

void LampHours::WriteLoop() {
  Status written;
  for (bool last = false; !last;) {
    std::string text;
    double hours_h = 0;
    {
      const MutexLock lock(mutex_);
      // (A disk that takes nothing is tried again after a pause, whatever is due.)
      const auto until = HostClock::now() + kWriteHost;
      while (!ending_ && (!due_ || !written.ok()) && HostClock::now() < until) {
        wake_.WaitFor(mutex_, until - HostClock::now());
      }
      last = ending_;
      due_ = false;
      const std::vector<double> hours = HoursLocked(latest_);
      hours_h = Sum(hours);
      if (hours_h > written_h_) text = TextLocked(hours);
    }
    if (text.empty()) continue;
    written = WriteFileAtomically(file_, text);
    if (!written.ok()) Log("safety").error("lamp-hours: {}", Message(written));
    const MutexLock lock(mutex_);
    if (written.ok()) written_h_ = hours_h;
  }
}

}  // namespace mesorig::daemon
