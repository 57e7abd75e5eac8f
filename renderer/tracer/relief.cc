#include "renderer/tracer/relief.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include "protocol/base/file_writer.h"

namespace mesorig::renderer {
namespace {

constexpr size_t kMaxFileBytes = size_t{1} << 30;
constexpr double kMaxCoordinateMm = 1e6;

// The next word of `line`, which it is cut from; empty at the end.
std::string_view NextWord(std::string_view& line) {
  const size_t first = line.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return line = {};
  const size_t end = std::min(line.find_first_of(" \t\r", first), line.size());
  const std::string_view word = line.substr(first, end - first);
  line.remove_prefix(end);
  return word;
}

template <typename T>
std::optional<T> ParseNumber(std::string_view word) {
  T value{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

std::optional<std::array<float, 3>> ParseVertex(std::string_view line) {
  std::array<float, 3> vertex;
  for (float& coordinate : vertex) {
    const auto value = ParseNumber<double>(NextWord(line));
    if (!value || !(std::abs(*value) <= kMaxCoordinateMm)) return std::nullopt;
    coordinate = static_cast<float>(*value);
  }
  return vertex;  // (a fourth number is a weight, which triangles do not have)
}

// `count` vertices are known so far.
std::optional<std::array<uint32_t, 3>> ParseFace(std::string_view line, size_t count) {
  std::array<uint32_t, 3> face;
  for (uint32_t& corner : face) {
    std::string_view word = NextWord(line);
    word = word.substr(0, word.find('/'));
    auto number = ParseNumber<int64_t>(word);
    if (number && *number < 0) number = static_cast<int64_t>(count) + 1 + *number;
    if (!number || *number < 1 || *number > static_cast<int64_t>(count)) return std::nullopt;
    corner = static_cast<uint32_t>(*number - 1);
  }
  if (!NextWord(line).empty()) return std::nullopt;  // more than three corners
  return face;
}

bool IsIgnored(std::string_view keyword) {
  static constexpr std::string_view kKeywords[] = {"vn", "vt", "vp", "o",      "g",
                                                   "s",  "l",  "p",  "mtllib", "usemtl"};
  return keyword.empty() || keyword[0] == '#' ||
         std::find(std::begin(kKeywords), std::end(kKeywords), keyword) != std::end(kKeywords);
}

}  // namespace

StatusOr<ReliefMesh> ParseRelief(std::string_view text, std::string_view name) {
  ReliefMesh mesh;
  for (size_t number = 1; !text.empty(); ++number) {
    const size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::string_view keyword = NextWord(line);
    if (keyword == "v") {
      const auto vertex = ParseVertex(line);
      if (!vertex) {
        return InvalidArgument("{}:{}: a vertex is `v x y z`, finite numbers (mm) within 1e6", name,
                               number);
      }
      mesh.vertices.push_back(*vertex);
    } else if (keyword == "f") {
      const auto face = ParseFace(line, mesh.vertices.size());
      if (!face) {
        return InvalidArgument("{}:{}: a face is `f a b c`, three of the {} vertices so far", name,
                               number, mesh.vertices.size());
      }
      mesh.triangles.push_back(*face);
    } else if (!IsIgnored(keyword)) {
      return InvalidArgument("{}:{}: not a line of a Wavefront OBJ of triangles", name, number);
    }
  }
  if (mesh.triangles.empty()) return InvalidArgument("{}: has no triangles", name);
  return mesh;
}

StatusOr<ReliefMesh> ReadRelief(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxFileBytes));
  return ParseRelief(text, path.string());
}

StatusOr<Relief> Relief::Create(const ReliefMesh& mesh, double width_mm, double height_mm) {
  MESORIG_ASSIGN_OR_RETURN(EmbreeScene scene, EmbreeScene::Create(mesh.vertices, mesh.triangles));
  Relief relief(std::move(scene));
  relief.width_mm_ = width_mm;
  relief.height_mm_ = height_mm;
  double top = -kMaxCoordinateMm;
  for (const auto& vertex : mesh.vertices) top = std::max(top, double{vertex[2]});
  relief.start_mm_ = top + 1;
  // What the highest rays see: the highest and lowest point are corners of triangles, but of a
  // coarse mesh none may lie within the part.
  double lowest = kMaxCoordinateMm, highest = -kMaxCoordinateMm;
  const auto add = [&](double x, double y) {
    const auto hit = relief.scene_.Intersect({x, y, relief.start_mm_}, {0, 0, -1}, 0);
    if (!hit.any) return;
    lowest = std::min(lowest, relief.start_mm_ - hit.t);
    highest = std::max(highest, relief.start_mm_ - hit.t);
  };
  for (const auto& vertex : mesh.vertices) {
    if (std::abs(vertex[0]) < width_mm / 2 && std::abs(vertex[1]) < height_mm / 2) {
      add(vertex[0], vertex[1]);
    }
  }
  constexpr int kGrid = 64;
  for (int j = 0; j <= kGrid; ++j) {
    for (int i = 0; i <= kGrid; ++i) {
      add(width_mm * (double{1} * i / kGrid - 0.5), height_mm * (double{1} * j / kGrid - 0.5));
    }
  }
  if (lowest > highest) {
    return InvalidArgument("the relief has nothing within {} x {} mm around the origin", width_mm,
                           height_mm);
  }
  relief.lowest_mm_ = lowest;
  relief.highest_mm_ = highest;
  return relief;
}

double Relief::HeightAt(double x_mm, double y_mm) const {
  const auto hit = scene_.Intersect({x_mm, y_mm, start_mm_}, {0, 0, -1}, 0);
  return hit.any ? start_mm_ - hit.t : lowest_mm_;
}

}  // namespace mesorig::renderer
