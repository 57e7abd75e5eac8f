#include "simulator/devices/faults/fault_script.h"

#include <algorithm>
#include <fstream>
#include <sstream>

#include "simulator/devices/faults/fault_table.h"

namespace mesorig::simulator {
namespace {

constexpr double kLatest_s = 1e8;  // three years

StatusOr<sim_wire::TimedInjection> ParseLine(std::string_view line, const Rig& rig) {
  const std::vector<std::string_view> words = FaultWords(line);
  if (words.size() < 4 || words[0] != "at") {
    return InvalidArgument("\"{}\" is not: at SECONDS DEVICE FAULT...", line);
  }
  double seconds = 0;
  MESORIG_RETURN_IF_ERROR(FaultReal(words, 1, 0, kLatest_s, seconds));
  std::string text;
  for (size_t i = 2; i < words.size(); ++i) text += fmt::format("{}{}", i > 2 ? " " : "", words[i]);
  MESORIG_RETURN_IF_ERROR(CheckFault(rig, text));
  return sim_wire::TimedInjection{FromSeconds(seconds), std::move(text)};
}

}  // namespace

StatusOr<std::vector<sim_wire::TimedInjection>> ParseFaultScript(std::string_view text,
                                                                 std::string_view path,
                                                                 const Rig& rig) {
  std::vector<sim_wire::TimedInjection> script;
  for (int number = 1; !text.empty(); ++number) {
    const size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    line = line.substr(0, line.find('#'));
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (FaultWords(line).empty()) continue;
    auto entry = ParseLine(line, rig);
    if (!entry.ok()) return Annotate(entry.status(), fmt::format("{}:{}", path, number));
    script.push_back(*std::move(entry));
  }
  std::stable_sort(script.begin(), script.end(),
                   [](const auto& a, const auto& b) { return a.at < b.at; });
  return script;
}

StatusOr<std::vector<sim_wire::TimedInjection>> LoadFaultScript(const std::filesystem::path& path,
                                                                const Rig& rig) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return NotFound("{}: cannot be opened", path.string());
  std::ostringstream text;
  text << file.rdbuf();
  if (!file) return Unavailable("{}: cannot be read", path.string());
  return ParseFaultScript(text.str(), path.string(), rig);
}

}  // namespace mesorig::simulator
