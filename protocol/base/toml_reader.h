#pragma once
// Reads TOML that people write (rigs, plans, samples, scenes) and refuses what it does not know:
// every error names file, line and column, and a key that nobody asked for is an error.
//
//   MESORIG_ASSIGN_OR_RETURN(TomlFile file, TomlFile::Load(path));
//   TomlTable root = file.root();
//   rig.name = root.String("name");
//   axis.max_velocity = root.Number("max_velocity_deg_s", {0.001, 1e4});
//   for (TomlTable camera : root.Tables("camera")) …
//   return file.Finish();   // first error in file order, or the first unknown key
//
// Getters return a default-constructed value after an error, so that a reader runs straight to
// Finish. Angles in files are degrees and carry `_deg` in their key; convert with RadFromDeg.

#include <deque>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig {

struct Range {
  double low = -1e300, high = 1e300;
};

class TomlFile;

// A view of one table; copyable, valid while its TomlFile lives.
class TomlTable {
 public:
  bool Has(std::string_view key) const;
  // Required values: an error when the key is missing, of another type or out of range.
  double Number(std::string_view key, Range range = {});  // NaN and infinities are refused
  int64_t Integer(std::string_view key, Range range = {});
  bool Bool(std::string_view key);
  std::string String(std::string_view key);
  // One of the words given.
  std::string Word(std::string_view key, std::initializer_list<std::string_view> permitted);
  Vec3 Vector(std::string_view key, Range range = {});  // array of three numbers
  std::vector<double> Numbers(std::string_view key, Range range = {});
  std::vector<std::string> Strings(std::string_view key);
  // The same with a value for a missing key.
  double NumberOr(std::string_view key, double fallback, Range range = {});
  int64_t IntegerOr(std::string_view key, int64_t fallback, Range range = {});
  bool BoolOr(std::string_view key, bool fallback);
  std::string StringOr(std::string_view key, std::string_view fallback);
  Vec3 VectorOr(std::string_view key, Vec3 fallback, Range range = {});

  // [key]; an error when it is missing.
  TomlTable Table(std::string_view key);
  std::optional<TomlTable> TableIfPresent(std::string_view key);
  // [[key]], in file order; empty when there is none.
  std::vector<TomlTable> Tables(std::string_view key);

  // Reports `message` at the place of `key` (or of the table, when it is empty).
  void Error(std::string_view key, std::string_view message);
  // "file.toml:12:3", the place of the key or of the table.
  std::string Where(std::string_view key = "") const;

  struct Node;

 private:
  friend class TomlFile;
  explicit TomlTable(Node* node) : node_(node) {}
  Node* node_;
};

class TomlFile {
 public:
  // NotFound, or InvalidArgument with file:line:column of a syntax error.
  static StatusOr<TomlFile> Load(const std::filesystem::path& path);
  static StatusOr<TomlFile> Parse(std::string_view text, std::string_view name);
  TomlFile(TomlFile&&) noexcept;
  TomlFile& operator=(TomlFile&&) noexcept;
  ~TomlFile();
  TomlTable root();
  // The error that stands first in the file: a getter's, or an unknown key.
  Status Finish();
  const std::string& text() const;  // the file as read

 private:
  struct State;
  explicit TomlFile(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
  friend class TomlTable;
};

}  // namespace mesorig
