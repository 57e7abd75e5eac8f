#include "processing/exchange/multi_light/light_file.h"

#include <charconv>
#include <cmath>

namespace mesorig::exchange::multi_light {
namespace {

constexpr size_t kMaxLights = 16384;
constexpr std::string_view kBlank = " \t\r\v\f";

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

struct Line {
  size_t number;
  std::string_view text;  // trimmed, not empty
};

std::string_view Trimmed(std::string_view text) {
  const size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::vector<Line> LinesOf(std::string_view text) {
  std::vector<Line> lines;
  for (size_t number = 1; !text.empty() && lines.size() <= kMaxLights + 1; ++number) {
    const size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = Trimmed(text.substr(0, end));
    if (!line.empty()) lines.push_back({number, line});
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

// The last word of `text`, which it loses.
std::string_view TakeLastWord(std::string_view& text) {
  const size_t at = text.find_last_of(kBlank);
  const std::string_view word = at == std::string_view::npos ? text : text.substr(at + 1);
  text = Trimmed(text.substr(0, text.size() - word.size()));
  return word;
}

// For messages: a hostile file's bytes stay out of the terminal.
std::string Printable(std::string_view text) {
  std::string result;
  for (const char c : text.substr(0, 40)) result.push_back(c >= 32 && c < 127 ? c : '?');
  return result;
}

StatusOr<LightEntry> ParseEntry(const Line& line, const std::string& file) {
  LightEntry entry;
  std::string_view rest = line.text;
  double* const fields[] = {&entry.direction.z, &entry.direction.y, &entry.direction.x};
  constexpr std::string_view kNames[] = {"z", "y", "x"};
  for (size_t i = 0; i < 3; ++i) {
    const std::string_view word = TakeLastWord(rest);
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), *fields[i]);
    if (word.empty() || error != std::errc() || end != word.data() + word.size() ||
        !std::isfinite(*fields[i])) {
      return InvalidArgument("{}:{}: {} = `{}` is not a number", file, line.number, kNames[i],
                             Printable(word));
    }
  }
  const double length = Norm(entry.direction);
  if (!(length > 1e-6) || !std::isfinite(length)) {
    return InvalidArgument("{}:{}: the light vector has no direction (length {})", file,
                           line.number, length);
  }
  entry.direction = (1 / length) * entry.direction;
  entry.image = rest;
  return entry;
}

StatusOr<std::vector<LightEntry>> Parse(std::string_view text, const std::string& file,
                                        bool with_names) {
  const std::vector<Line> lines = LinesOf(text);
  if (lines.empty()) return InvalidArgument("{}: is empty", file);
  size_t count = 0;
  const std::string_view first = lines[0].text;
  const auto [end, error] = std::from_chars(first.data(), first.data() + first.size(), count);
  if (error != std::errc() || end != first.data() + first.size() || count < 1 ||
      count > kMaxLights) {
    return InvalidArgument("{}:{}: count `{}` is not a number in [1, {}]", file, lines[0].number,
                           Printable(first), kMaxLights);
  }
  if (lines.size() != count + 1) {
    return InvalidArgument("{}: announces {} lights, holds {}", file, count, lines.size() - 1);
  }
  std::vector<LightEntry> entries;
  for (size_t i = 1; i < lines.size(); ++i) {
    MESORIG_ASSIGN_OR_RETURN(LightEntry entry, ParseEntry(lines[i], file));
    if (entry.image.empty() == with_names) {
      return InvalidArgument("{}:{}: expected `{}x y z`", file, lines[i].number,
                             with_names ? "image " : "");
    }
    entries.push_back(std::move(entry));
  }
  return entries;
}

}  // namespace

StatusOr<std::vector<LightEntry>> ParseLp(std::string_view text, const std::string& file) {
  return Parse(text, file, true);
}

StatusOr<std::vector<LightEntry>> ParseLights(std::string_view text, const std::string& file) {
  return Parse(text, file, false);
}

bool NaturalLess(std::string_view a, std::string_view b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (IsDigit(a[i]) && IsDigit(b[j])) {
      const auto number = [](std::string_view text, size_t& at) {
        while (at + 1 < text.size() && text[at] == '0' && IsDigit(text[at + 1])) ++at;
        const size_t begin = at;
        while (at < text.size() && IsDigit(text[at])) ++at;
        return text.substr(begin, at - begin);
      };
      const std::string_view x = number(a, i), y = number(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
    }
  }
  return a.size() - i < b.size() - j || (i == a.size() && j == b.size() && a < b);
}

}  // namespace mesorig::exchange::multi_light
