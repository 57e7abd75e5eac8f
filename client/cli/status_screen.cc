#include "client/cli/status_screen.h"

#include <fmt/core.h>

#include <algorithm>

#include "client/cli/text.h"

namespace mesorig::client {
namespace {

constexpr size_t kReadingsShown = 15, kReadingColumns = 3, kReadingWidth = 26;
constexpr size_t kConsumersShown = 2, kLinesBelowReadings = 5;

// Cut to the screen; control characters out, so that nothing that a client sent moves the cursor.
std::string Fit(std::string line) {
  std::replace_if(
      line.begin(), line.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  if (line.size() > kScreenColumns) line = line.substr(0, kScreenColumns - 3) + "...";
  return line;
}

class Screen {
 public:
  static constexpr size_t kNameColumns = 10, kTextColumns = kScreenColumns - kNameColumns;
  void Add(std::string_view name, std::string text) {
    lines_.push_back(Fit(fmt::format("{:<{}}{}", name, kNameColumns, text)));
  }
  // Over so many lines at most, between words.
  void AddWrapped(std::string_view name, std::string_view text, int lines) {
    for (; lines > 1 && text.size() > kTextColumns; --lines) {
      const size_t space = text.rfind(' ', kTextColumns);
      const size_t end = space == text.npos || space == 0 ? kTextColumns : space;
      Add(name, std::string(text.substr(0, end)));
      text.remove_prefix(end + (space == end ? 1 : 0));
      name = "";
    }
    Add(name, std::string(text));
  }
  void AddRaw(std::string line) { lines_.push_back(Fit(std::move(line))); }
  size_t free() const { return kScreenLines - std::min(kScreenLines, lines_.size()); }
  std::string Text() const {
    std::string text;
    for (const std::string& line : lines_) text += line + '\n';
    return text;
  }

 private:
  std::vector<std::string> lines_;
};

std::string Age(double seconds) { return fmt::format("{:.1f} s", seconds); }

std::string ShortAge(double seconds) {
  return seconds < 9.95 ? fmt::format("{:.1f}s", seconds)
                        : fmt::format("{:.0f}s", std::min(seconds, 9999.0));
}

const v1::Reading* Find(const v1::StatusReply& status, std::string_view name) {
  for (const v1::Reading& reading : status.readings()) {
    if (reading.name() == name) return &reading;
  }
  return nullptr;
}

std::string ChainText(const v1::StatusReply& status) {
  std::string text;
  for (const char* name : {"estop", "door"}) {
    const v1::Reading* reading = Find(status, name);
    if (!text.empty()) text += ", ";
    text += reading == nullptr
                ? fmt::format("{} never read", name)
                : fmt::format("{} {} ({} ago)", name, reading->value() > 0.5 ? "closed" : "OPEN",
                              Age(reading->age_s()));
  }
  return text;
}

void AddSession(const v1::StatusReply& status, Screen& screen) {
  if (status.session_id().empty()) {
    screen.Add("session", "none yet");
    return;
  }
  screen.Add("session", status.session_id());
  constexpr size_t kBar = 20;
  const double done =
      status.shots() == 0 ? 0 : static_cast<double>(status.shots_done()) / status.shots();
  const auto filled = static_cast<size_t>(std::clamp(done, 0.0, 1.0) * kBar);
  std::string frames =
      fmt::format("[{}{}] {}/{} shots, {}/{} frames durable", std::string(filled, '#'),
                  std::string(kBar - filled, '.'), status.shots_done(), status.shots(),
                  status.frames_durable(), status.frames());
  if (status.frames_queued() > 0) frames += fmt::format(", {} queued", status.frames_queued());
  screen.Add("", std::move(frames));
  screen.Add("", fmt::format("{} of about {}; {} to go, {} to come", DurationText(status.rig_s()),
                             DurationText(status.estimated_s()), DurationText(status.remaining_s()),
                             BytesText(status.bytes_left())));
}

void AddDisk(const v1::StatusReply& status, Screen& screen) {
  const bool fits = status.disk_free_bytes() >= status.bytes_left();
  std::string disk = fmt::format("{} free{}", BytesText(status.disk_free_bytes()),
                                 fits ? "" : ": THE SESSION WILL NOT FIT");
  if (!status.storage().empty()) disk += fmt::format("; TAKES NOTHING: {}", status.storage());
  screen.Add("disk", std::move(disk));
}

void AddConsumers(const v1::StatusReply& status, Screen& screen) {
  if (status.consumers().empty()) screen.Add("consumers", "none");
  size_t shown = 0;
  for (const v1::Consumer& consumer : status.consumers()) {
    if (shown == kConsumersShown) {
      screen.Add("", fmt::format("and {} more", status.consumers_size() - kConsumersShown));
      break;
    }
    screen.Add(shown++ == 0 ? "consumers" : "",
               fmt::format("{}: {} streams, {} frames", consumer.peer(), consumer.streams(),
                           consumer.frames_sent()));
  }
}

void AddReadings(const v1::StatusReply& status, Screen& screen) {
  std::vector<std::string> cells;
  for (const v1::Reading& reading : status.readings()) {
    if (reading.name() == "estop" || reading.name() == "door") continue;
    const std::string unit = reading.unit() == "1" ? "" : " " + reading.unit();
    cells.push_back(fmt::format("{:.9} {:.3f}{} {}", reading.name(), reading.value(), unit,
                                ShortAge(reading.age_s())) +
                    (reading.source() == v1::COMMANDED ? " c" : ""));
  }
  // (Below them: what is said of them, and the latest events.)
  const size_t rows = screen.free() - std::min(screen.free(), kLinesBelowReadings);
  const size_t shown = std::min(kReadingsShown, std::max<size_t>(rows, 1) * kReadingColumns);
  const size_t more = cells.size() - std::min(cells.size(), shown);
  cells.resize(cells.size() - more);
  if (cells.empty()) screen.Add("readings", "none yet");
  for (size_t i = 0; i < cells.size(); i += kReadingColumns) {
    std::string line;
    for (size_t k = i; k < std::min(i + kReadingColumns, cells.size()); ++k) {
      line += fmt::format("{:<{}.{}} ", cells[k], kReadingWidth - 3, kReadingWidth - 3);
    }
    screen.Add(i == 0 ? "readings" : "", std::move(line));
  }
  if (more > 0) screen.Add("", fmt::format("and {} more: --json", more));
  const bool commanded =
      std::any_of(status.readings().begin(), status.readings().end(),
                  [](const v1::Reading& reading) { return reading.source() == v1::COMMANDED; });
  if (commanded) screen.Add("", "c: as commanded, not read back");
}

}  // namespace

std::string StatusScreen(const v1::HelloReply& hello, const v1::StatusReply& status,
                         const std::vector<v1::Event>& events) {
  Screen screen;
  screen.AddRaw(fmt::format("{} on rig {}, up {}{}", hello.server(), hello.rig_name(),
                            DurationText(status.uptime_s()),
                            status.deterministic() ? "" : ", time not deterministic"));
  screen.Add("state", fmt::format("{}{}{}", StateName(status.state()),
                                  status.message().empty() ? "" : ": ", status.message()));
  screen.Add("chain", ChainText(status));
  screen.Add("lease", LeaseText(status.lease()) +
                          (status.manual().empty() ? "" : "; by hand: " + status.manual()));
  if (!status.audit_trouble().empty()) screen.Add("audit", status.audit_trouble());
  if (status.has_prompt()) {
    screen.AddWrapped("asks", status.prompt().text(), 3);
    screen.Add("needs", StillNeeded(status.prompt()));
  }
  AddSession(status, screen);
  AddDisk(status, screen);
  screen.Add("frames",
             fmt::format("{} late, {} lost, {} refused since the daemon began",
                         status.frames_late(), status.frames_lost(), status.frames_refused()));
  screen.Add("alarms", status.alarms() == 0
                           ? "none"
                           : fmt::format("{} in this run: mesorig watch", status.alarms()));
  AddConsumers(status, screen);
  AddReadings(status, screen);
  const size_t shown = std::min(events.size(), screen.free());
  for (size_t i = events.size() - shown; i < events.size(); ++i) {
    screen.Add(i == events.size() - shown ? "events" : "",
               fmt::format("{} {}", events[i].sequence(), EventText(events[i])));
  }
  return screen.Text();
}

}  // namespace mesorig::client
