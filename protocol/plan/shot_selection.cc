#include "protocol/plan/shot_selection.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <set>
#include <string>

namespace mesorig {
namespace {

constexpr size_t kMaxText = 100'000;

std::string_view Trimmed(std::string_view text) {
  const size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// At commas outside of double quotes.
std::vector<std::string_view> Terms(std::string_view text) {
  std::vector<std::string_view> terms;
  size_t start = 0;
  bool quoted = false;
  for (size_t i = 0; i <= text.size(); ++i) {
    if (i < text.size() && text[i] == '"') quoted = !quoted;
    if (i < text.size() && (text[i] != ',' || quoted)) continue;
    terms.push_back(Trimmed(text.substr(start, i - start)));
    start = i + 1;
  }
  return terms;
}

std::string_view Unquoted(std::string_view name) {
  const bool quoted = name.size() >= 2 && name.front() == '"' && name.back() == '"';
  return quoted ? name.substr(1, name.size() - 2) : name;
}

std::optional<uint32_t> Number(std::string_view text) {
  uint32_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return number;
}

struct ShotRange {
  uint32_t first = 0, last = 0;
};

class Selection {
 public:
  Selection(const CompiledPlan& plan, const Rig& rig) : plan_(plan), rig_(rig) {}

  Status Take(std::string_view term) {
    const size_t space = term.find_first_of(" \t");
    const std::string_view word = term.substr(0, space);
    const std::string_view rest =
        space == std::string_view::npos ? "" : Trimmed(term.substr(space));
    if (word == "shot" || word == "shots") return TakeShots(term, rest);
    if (word == "camera")
      return TakeName(rest, rig_.FindCamera(Unquoted(rest)), "camera", cameras_);
    if (word == "lamp") return TakeName(rest, rig_.FindLamp(Unquoted(rest)), "lamp", lamps_);
    if (word == "sweep") return TakeSweep(rest);
    if (rest.empty()) {
      for (const auto& [name, purpose] : kPurposes) {
        if (word != name) continue;
        purposes_.insert(purpose);
        return OkStatus();
      }
    }
    return InvalidArgument(
        "\"{}\": a selection has terms like `shots 10-20`, `camera NAME`, `lamp "
        "NAME`, `sweep 3`, `dark`, `ambient`, `flat` and `data`",
        term);
  }

  ShotSelection Result() const {
    ShotSelection selection;
    int lamp = -1;
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kLamp) lamp = step.lamp;
      const bool sweeps = step.kind == StepKind::kSweep;
      if (step.kind != StepKind::kShot && !sweeps) continue;
      if (!purposes_.empty() && !purposes_.contains(step.purpose)) continue;
      if (!lamps_.empty() && (sweeps || !lamps_.contains(lamp))) continue;
      if (!sweeps_.empty() && !(sweeps && sweeps_.contains(step.sweep.index))) continue;
      std::vector<int> cameras;
      for (const int c : step.cameras) {
        if (cameras_.empty() || cameras_.contains(c)) cameras.push_back(c);
      }
      const uint32_t shots = sweeps ? step.sweep.frames : 1;
      for (uint32_t i = 0; i < shots && !cameras.empty(); ++i) {
        if (Holds(step.shot + i)) selection.push_back({step.shot + i, cameras});
      }
    }
    std::sort(selection.begin(), selection.end(),
              [](const auto& a, const auto& b) { return a.shot < b.shot; });
    return selection;
  }

 private:
  static constexpr std::pair<std::string_view, Purpose> kPurposes[] = {
      {"data", Purpose::kData},
      {"ambient", Purpose::kAmbient},
      {"dark", Purpose::kDark},
      {"flat", Purpose::kFlat}};

  Status TakeShots(std::string_view term, std::string_view rest) {
    const size_t dash = rest.find('-');
    const auto first = Number(Trimmed(rest.substr(0, dash)));
    const auto last =
        dash == std::string_view::npos ? first : Number(Trimmed(rest.substr(dash + 1)));
    if (!first || !last) {
      return InvalidArgument("\"{}\": a shot's number, or two like 10-20, was expected", term);
    }
    if (*first > *last) return InvalidArgument("\"{}\": ends before it begins", term);
    if (*last >= plan_.shots) {
      return InvalidArgument("\"{}\": the plan has the shots 0 to {}", term,
                             plan_.shots == 0 ? 0 : plan_.shots - 1);
    }
    shots_.push_back({*first, *last});
    return OkStatus();
  }
  Status TakeName(std::string_view name, std::optional<int> index, const char* what,
                  std::set<int>& chosen) const {
    if (!index)
      return InvalidArgument("{} \"{}\": the rig {} has none of this name", what, Unquoted(name),
                             rig_.name);
    chosen.insert(*index);
    return OkStatus();
  }
  Status TakeSweep(std::string_view rest) {
    const auto sweep = Number(rest);
    if (!sweep || *sweep >= plan_.sweeps) {
      return InvalidArgument("sweep \"{}\": the plan has {} sweeps, counted from 0", rest,
                             plan_.sweeps);
    }
    sweeps_.insert(*sweep);
    return OkStatus();
  }
  bool Holds(uint32_t shot) const {
    return shots_.empty() || std::any_of(shots_.begin(), shots_.end(), [&](const ShotRange& range) {
             return shot >= range.first && shot <= range.last;
           });
  }

  const CompiledPlan& plan_;
  const Rig& rig_;
  std::vector<ShotRange> shots_;
  std::set<int> cameras_, lamps_;
  std::set<uint32_t> sweeps_;
  std::set<Purpose> purposes_;
};

}  // namespace

StatusOr<ShotSelection> ParseShotSelection(std::string_view text, const CompiledPlan& plan,
                                           const Rig& rig) {
  if (text.size() > kMaxText) {
    return InvalidArgument("a selection of {} characters, permitted is {}", text.size(), kMaxText);
  }
  if (Trimmed(text).empty()) return InvalidArgument("an empty selection");
  Selection chosen(plan, rig);
  for (const std::string_view term : Terms(text)) MESORIG_RETURN_IF_ERROR(chosen.Take(term));
  ShotSelection selection = chosen.Result();
  if (selection.empty()) return InvalidArgument("\"{}\": no frame of the plan is so", text);
  return selection;
}

}  // namespace mesorig
