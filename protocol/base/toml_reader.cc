#include "protocol/base/toml_reader.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <set>
#include <stdexcept>

// toml++ 3.3 asserts on some malformed keys and would end the process: its assertions become
// syntax errors.
namespace mesorig {
[[noreturn]] inline void FailTomlAssertion() { throw std::logic_error("malformed key or value"); }
}  // namespace mesorig
#define TOML_ASSERT(condition) ((condition) ? void() : ::mesorig::FailTomlAssertion())
#undef NDEBUG  // with it toml++ would assume what is not so
#include <toml++/toml.h>

#include "protocol/base/file_writer.h"

namespace mesorig {

struct TomlTable::Node {
  toml::table* table;  // null for a missing table: every getter stays silent
  TomlFile::State* file;
  std::set<std::string, std::less<>> known;  // keys that were asked for
};

struct TomlFile::State {
  std::string name, text;
  toml::table root;
  std::deque<TomlTable::Node> nodes;  // stable addresses
  struct Found {
    toml::source_position at;
    std::string message;
  };
  std::vector<Found> errors;

  TomlTable::Node* Add(toml::table* table) {
    for (auto& node : nodes) {
      if (node.table == table && table != nullptr) return &node;
    }
    return &nodes.emplace_back(TomlTable::Node{table, this, {}});
  }
  std::string Place(toml::source_position at) const {
    return fmt::format("{}:{}:{}", name, at.line, at.column);
  }
};

namespace {

toml::node* Find(TomlTable::Node* node, std::string_view key) {
  node->known.emplace(key);
  return node->table != nullptr ? node->table->get(key) : nullptr;
}

}  // namespace

bool TomlTable::Has(std::string_view key) const { return Find(node_, key) != nullptr; }

void TomlTable::Error(std::string_view key, std::string_view message) {
  if (node_->table == nullptr) return;  // the missing table was reported
  toml::source_position at = node_->table->source().begin;
  if (!key.empty()) {
    if (const toml::node* value = node_->table->get(key)) at = value->source().begin;
    for (const auto& [k, unused] : *node_->table) {
      if (k.str() == key) at = k.source().begin;
    }
  }
  node_->file->errors.push_back(
      {at, key.empty() ? std::string(message) : fmt::format("`{}` {}", key, message)});
}

std::string TomlTable::Where(std::string_view key) const {
  if (node_->table == nullptr) return node_->file->name;
  toml::source_position at = node_->table->source().begin;
  for (const auto& [k, unused] : *node_->table) {
    if (k.str() == key) at = k.source().begin;
  }
  return node_->file->Place(at);
}

double TomlTable::Number(std::string_view key, Range range) {
  const toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  const auto number = value->is_boolean() ? std::nullopt : value->value<double>();
  if (!number) {
    Error(key, "must be a number");
    return {};
  }
  if (!std::isfinite(*number) || *number < range.low || *number > range.high) {
    Error(key, fmt::format("is {}, permitted is {} to {}", *number, range.low, range.high));
    return {};
  }
  return *number;
}

int64_t TomlTable::Integer(std::string_view key, Range range) {
  const toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  if (!value->is_integer()) {
    Error(key, "must be a whole number");
    return {};
  }
  const int64_t number = value->value<int64_t>().value();
  if (static_cast<double>(number) < range.low || static_cast<double>(number) > range.high) {
    Error(key, fmt::format("is {}, permitted is {} to {}", number, range.low, range.high));
    return {};
  }
  return number;
}

bool TomlTable::Bool(std::string_view key) {
  const toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  if (!value->is_boolean()) {
    Error(key, "must be true or false");
    return {};
  }
  return value->value<bool>().value();
}

std::string TomlTable::String(std::string_view key) {
  const toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  if (!value->is_string()) {
    Error(key, "must be a string");
    return {};
  }
  return value->value<std::string>().value();
}

std::string TomlTable::Word(std::string_view key,
                            std::initializer_list<std::string_view> permitted) {
  const toml::node* present = Find(node_, key);
  std::string word = String(key);
  if (present == nullptr || !present->is_string()) return word;
  if (std::find(permitted.begin(), permitted.end(), word) == permitted.end()) {
    Error(key, fmt::format("is \"{}\", permitted is {}", word, fmt::join(permitted, ", ")));
  }
  return word;
}

std::vector<double> TomlTable::Numbers(std::string_view key, Range range) {
  toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  const toml::array* array = value->as_array();
  std::vector<double> numbers;
  if (array != nullptr) {
    for (const toml::node& item : *array) {
      const auto number = item.is_boolean() ? std::nullopt : item.value<double>();
      if (!number || !std::isfinite(*number) || *number < range.low || *number > range.high) {
        Error(key, number ? fmt::format("holds {}, permitted is {} to {}", *number, range.low,
                                        range.high)
                          : std::string("must hold numbers only"));
        return {};
      }
      numbers.push_back(*number);
    }
    return numbers;
  }
  Error(key, "must be an array of numbers");
  return {};
}

Vec3 TomlTable::Vector(std::string_view key, Range range) {
  const size_t errors = node_->file->errors.size();
  const std::vector<double> numbers = Numbers(key, range);
  if (numbers.size() == 3) return {numbers[0], numbers[1], numbers[2]};
  if (node_->file->errors.size() == errors) {
    Error(key, fmt::format("holds {} numbers, three are needed", numbers.size()));
  }
  return {};
}

std::vector<std::string> TomlTable::Strings(std::string_view key) {
  toml::node* value = Find(node_, key);
  if (value == nullptr) {
    Error("", fmt::format("`{}` is missing", key));
    return {};
  }
  std::vector<std::string> strings;
  const toml::array* array = value->as_array();
  bool good = array != nullptr;
  if (good) {
    for (const toml::node& item : *array) {
      good = good && item.is_string();
      if (good) strings.push_back(item.value<std::string>().value());
    }
  }
  if (!good) {
    Error(key, "must be an array of strings");
    return {};
  }
  return strings;
}

double TomlTable::NumberOr(std::string_view key, double fallback, Range range) {
  return Has(key) ? Number(key, range) : fallback;
}
int64_t TomlTable::IntegerOr(std::string_view key, int64_t fallback, Range range) {
  return Has(key) ? Integer(key, range) : fallback;
}
bool TomlTable::BoolOr(std::string_view key, bool fallback) {
  return Has(key) ? Bool(key) : fallback;
}
std::string TomlTable::StringOr(std::string_view key, std::string_view fallback) {
  return Has(key) ? String(key) : std::string(fallback);
}
Vec3 TomlTable::VectorOr(std::string_view key, Vec3 fallback, Range range) {
  return Has(key) ? Vector(key, range) : fallback;
}

TomlTable TomlTable::Table(std::string_view key) {
  toml::node* value = Find(node_, key);
  toml::table* table = value != nullptr ? value->as_table() : nullptr;
  if (value == nullptr) {
    Error("", fmt::format("[{}] is missing", key));
  } else if (table == nullptr) {
    Error(key, "must be a table");
  }
  return TomlTable(node_->file->Add(table));
}

std::optional<TomlTable> TomlTable::TableIfPresent(std::string_view key) {
  if (!Has(key)) return std::nullopt;
  return Table(key);
}

std::vector<TomlTable> TomlTable::Tables(std::string_view key) {
  std::vector<TomlTable> tables;
  toml::node* value = Find(node_, key);
  if (value == nullptr) return tables;
  toml::array* array = value->as_array();
  if (array == nullptr || !array->is_array_of_tables()) {
    Error(key, fmt::format("must be written as [[{}]]", key));
    return tables;
  }
  for (toml::node& item : *array) tables.push_back(TomlTable(node_->file->Add(item.as_table())));
  return tables;
}

TomlFile::TomlFile(std::unique_ptr<State> state) : state_(std::move(state)) {}
TomlFile::TomlFile(TomlFile&&) noexcept = default;
TomlFile& TomlFile::operator=(TomlFile&&) noexcept = default;
TomlFile::~TomlFile() = default;

namespace {

// Just after the string that begins at `at` (its end may be missing).
size_t AfterString(std::string_view text, size_t at) {
  const char quote = text[at];
  const std::string fence(3, quote);
  const bool lines = text.substr(at, 3) == fence;
  for (at += lines ? 3 : 1; at < text.size(); ++at) {
    if (quote == '"' && text[at] == '\\') {
      ++at;
    } else if (lines ? text.substr(at, 3) == fence : text[at] == quote || text[at] == '\n') {
      return at + (lines ? 3 : 1);
    }
  }
  return text.size();
}

// Where a character outside of ASCII stands that is in no string and no comment: TOML has none
// there, and toml++ 3.3 runs into undefined behaviour.
std::optional<toml::source_position> StrayCharacter(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  for (size_t at = text.starts_with(kByteOrderMark) ? 3 : 0; at < text.size();) {
    if (text[at] == '"' || text[at] == '\'') {
      at = AfterString(text, at);
    } else if (text[at] == '#') {
      at = std::min(text.find('\n', at), text.size());
    } else if (static_cast<unsigned char>(text[at]) < 0x80) {
      ++at;
    } else {
      const std::string_view before = text.substr(0, at);
      const size_t line = before.rfind('\n') + 1;  // (npos + 1 is 0)
      return toml::source_position{
          static_cast<toml::source_index>(std::count(before.begin(), before.end(), '\n') + 1),
          static_cast<toml::source_index>(at - line + 1)};
    }
  }
  return std::nullopt;
}

}  // namespace

StatusOr<TomlFile> TomlFile::Load(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, 4u << 20));
  return Parse(text, path.string());
}

StatusOr<TomlFile> TomlFile::Parse(std::string_view text, std::string_view name) {
  auto state = std::make_unique<State>();
  state->name = name;
  state->text = text;
  if (const auto stray = StrayCharacter(text)) {
    return InvalidArgument("{}: a character outside of ASCII that is in no string and no comment",
                           state->Place(*stray));
  }
  try {
    state->root = toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    return InvalidArgument("{}: {}", state->Place(error.source().begin), error.description());
  } catch (const std::exception& error) {
    return InvalidArgument("{}: not a TOML file: {}", name, error.what());
  }
  return TomlFile(std::move(state));
}

TomlTable TomlFile::root() { return TomlTable(state_->Add(&state_->root)); }
const std::string& TomlFile::text() const { return state_->text; }

namespace {

// Unknown keys of the tables that were visited; a table that nobody visited is itself unknown.
void CollectUnknown(const std::deque<TomlTable::Node>& nodes,
                    std::vector<std::pair<toml::source_position, std::string>>& found) {
  for (const auto& node : nodes) {
    if (node.table == nullptr) continue;
    for (const auto& [key, value] : *node.table) {
      if (node.known.find(key.str()) != node.known.end()) continue;
      // A [[table]] of an implicit key has no place of its own: use the value's.
      const auto at = key.source().begin.line > 0 ? key.source().begin : value.source().begin;
      found.emplace_back(at, fmt::format("unknown key `{}`; known here: {}", key.str(),
                                         fmt::join(node.known, ", ")));
    }
  }
}

}  // namespace

Status TomlFile::Finish() {
  std::vector<std::pair<toml::source_position, std::string>> found;
  for (const auto& error : state_->errors) found.emplace_back(error.at, error.message);
  CollectUnknown(state_->nodes, found);
  if (found.empty()) return OkStatus();
  const auto first = std::min_element(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return std::pair(a.first.line, a.first.column) < std::pair(b.first.line, b.first.column);
  });
  return InvalidArgument("{}: {}", state_->Place(first->first), first->second);
}

}  // namespace mesorig
