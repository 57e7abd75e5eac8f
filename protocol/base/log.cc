#include "protocol/base/log.h"

#include <fmt/ranges.h>
#include <spdlog/sinks/ringbuffer_sink.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

namespace mesorig {
namespace {

using Levels = std::array<spdlog::level::level_enum, kLogParts.size()>;

constexpr size_t kLinesKept = 2000;

struct Style {
  std::string program = "mesorig";
  LogFormat format = LogFormat::kText;
  bool priorities = false;  // "<4>" before each line, as journald reads it
};

// "2026-01-02T03:04:05.678Z"
std::string TimeText(spdlog::log_clock::time_point time) {
  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(time.time_since_epoch());
  const std::time_t seconds = ms.count() / 1000;
  std::tm utc{};
  ::gmtime_r(&seconds, &utc);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z", utc.tm_year + 1900,
                     utc.tm_mon + 1, utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec,
                     ms.count() % 1000);
}

// One event is one line, whatever a client put into it.
void AppendEscaped(std::string_view text, std::string& line) {
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\n') {
      line += "\\n";
    } else if (byte < 0x20 || byte == 0x7f) {
      line += fmt::format("\\x{:02x}", byte);
    } else {
      line += c;
    }
  }
}

int Priority(spdlog::level::level_enum level) {
  constexpr std::array<int, 7> kOfLevel = {7, 7, 6, 4, 3, 2, 6};  // sd-daemon(3)
  return kOfLevel[static_cast<size_t>(level)];
}

class LineFormatter final : public spdlog::formatter {
 public:
  explicit LineFormatter(Style style) : style_(std::move(style)) {}
  void format(const spdlog::details::log_msg& msg, spdlog::memory_buf_t& dest) override {
    const std::string_view part(msg.logger_name.data(), msg.logger_name.size());
    const std::string_view text(msg.payload.data(), msg.payload.size());
    const auto name = spdlog::level::to_string_view(msg.level);
    const std::string_view level(name.data(), name.size());
    std::string line;
    if (style_.priorities) line = fmt::format("<{}>", Priority(msg.level));
    if (style_.format == LogFormat::kJson) {
      const nlohmann::ordered_json json = {{"time", TimeText(msg.time)},
                                           {"program", style_.program},
                                           {"part", part},
                                           {"level", level},
                                           {"message", text}};
      line += json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    } else {
      line += fmt::format("{} {} {} {} ", TimeText(msg.time), style_.program, part, level);
      AppendEscaped(text, line);
    }
    line += '\n';
    dest.append(line.data(), line.data() + line.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<LineFormatter>(style_);
  }

 private:
  const Style style_;
};

// stderr is the socket that systemd gave.
bool StderrIsJournal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat file {};
  if (stream == nullptr || ::fstat(STDERR_FILENO, &file) != 0) return false;
  return fmt::format("{}:{}", file.st_dev, file.st_ino) == stream;
}

StatusOr<Levels> ParseLevels(std::string_view text) {
  static const std::map<std::string, spdlog::level::level_enum, std::less<>> kLevels = {
      {"trace", spdlog::level::trace}, {"debug", spdlog::level::debug},
      {"info", spdlog::level::info},   {"warn", spdlog::level::warn},
      {"error", spdlog::level::err},   {"critical", spdlog::level::critical},
      {"off", spdlog::level::off}};
  std::array<std::optional<spdlog::level::level_enum>, kLogParts.size()> of_part;
  auto general = spdlog::level::info;
  while (!text.empty()) {
    const std::string_view item = text.substr(0, text.find(','));
    text.remove_prefix(std::min(text.size(), item.size() + 1));
    const size_t equals = item.find('=');
    const std::string_view word = equals == item.npos ? item : item.substr(equals + 1);
    const auto level = kLevels.find(word);
    if (level == kLevels.end()) {
      return InvalidArgument(
          "log level \"{}\" is none of trace, debug, info, warn, error, critical, off", word);
    }
    if (equals == item.npos) {
      general = level->second;
      continue;
    }
    const auto part = std::find(kLogParts.begin(), kLogParts.end(), item.substr(0, equals));
    if (part == kLogParts.end()) {
      return InvalidArgument("log level of \"{}\": the parts are {}", item.substr(0, equals),
                             fmt::join(kLogParts, ", "));
    }
    of_part[static_cast<size_t>(part - kLogParts.begin())] = level->second;
  }
  Levels levels{};
  for (size_t i = 0; i < levels.size(); ++i) levels[i] = of_part[i].value_or(general);
  return levels;
}

class Logging {
 public:
  Logging() {
    const std::vector<spdlog::sink_ptr> sinks = {terminal_, recent_};
    for (size_t i = 0; i < loggers_.size(); ++i) {
      loggers_[i] = std::make_shared<spdlog::logger>(std::string(kLogParts[i]), sinks.begin(),
                                                     sinks.end());
      loggers_[i]->flush_on(spdlog::level::info);
    }
    Apply({}, {});
    spdlog::set_default_logger(loggers_[0]);
  }
  void Apply(const Style& style, const std::optional<Levels>& levels) {
    style_ = style;
    Style kept = style;
    kept.priorities = false;
    terminal_->set_formatter(std::make_unique<LineFormatter>(style));
    recent_->set_formatter(std::make_unique<LineFormatter>(kept));
    for (size_t i = 0; i < loggers_.size(); ++i) {
      loggers_[i]->set_level(levels ? (*levels)[i] : spdlog::level::info);
    }
  }
  const Style& style() const { return style_; }
  spdlog::logger& logger(size_t part) { return *loggers_[part]; }
  std::vector<std::string> Recent() { return recent_->last_formatted(); }

 private:
  // Shared with the loggers, as spdlog has it.
  const std::shared_ptr<spdlog::sinks::stderr_sink_mt> terminal_ =
      std::make_shared<spdlog::sinks::stderr_sink_mt>();
  const std::shared_ptr<spdlog::sinks::ringbuffer_sink_mt> recent_ =
      std::make_shared<spdlog::sinks::ringbuffer_sink_mt>(kLinesKept);
  std::array<std::shared_ptr<spdlog::logger>, kLogParts.size()> loggers_;
  Style style_;
};

// Never destroyed: threads log until the process ends.
Logging& TheLogging() {
  static Logging* const logging = new Logging;
  return *logging;
}

}  // namespace

void StartLogging(std::string_view program) {
  Style style;
  style.program = program;
  style.priorities = StderrIsJournal();
  const char* levels = std::getenv("MESORIG_LOG");
  const auto parsed = ParseLevels(levels == nullptr ? "info" : levels);
  TheLogging().Apply(style, parsed.ok() ? std::optional(*parsed) : std::nullopt);
  if (!parsed.ok()) Log("program").warn("MESORIG_LOG: {}", Message(parsed.status()));
}

Status CheckLogging(const LogOptions& options) { return ParseLevels(options.levels).status(); }

Status SetLogging(const LogOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(const Levels levels, ParseLevels(options.levels));
  Style style = TheLogging().style();
  style.format = options.format;
  TheLogging().Apply(style, levels);
  return OkStatus();
}

spdlog::logger& Log(LogPart part) { return TheLogging().logger(part.index); }

std::vector<std::string> RecentLog() { return TheLogging().Recent(); }

}  // namespace mesorig
