#include "processing/btf/exr_prescan.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <string>

namespace mesorig::btf {
namespace {

constexpr uint32_t kMagic = 20000630;
constexpr uint32_t kMultiPart = 0x1000, kNonImage = 0x800, kTiled = 0x200;
constexpr size_t kMaxName = 255;

struct FixedSize {
  std::string_view type;
  uint32_t bytes;
};
constexpr std::array<FixedSize, 20> kFixed = {{{"box2f", 16},        {"box2i", 16},
                                               {"chromaticities", 32}, {"compression", 1},
                                               {"double", 8},        {"envmap", 1},
                                               {"float", 4},         {"int", 4},
                                               {"keycode", 28},      {"lineOrder", 1},
                                               {"m33d", 72},         {"m33f", 36},
                                               {"m44d", 128},        {"m44f", 64},
                                               {"rational", 8},      {"timecode", 8},
                                               {"v2f", 8},           {"v2i", 8},
                                               {"v3f", 12},          {"v3i", 12}}};

// Reads little-endian, buffered; positions are counted so that no length passes the end.
class Scanner {
 public:
  Scanner(const std::filesystem::path& path, uint64_t size)
      : path_(path.string()), in_(path, std::ios::binary), left_(size) {}

  Status Header(bool& end);
  Status Begin(bool& multi_part);

 private:
  Status Short() const { return InvalidArgument("{}: ends inside its EXR header", path_); }
  StatusOr<uint32_t> U32() {
    std::array<unsigned char, 4> raw{};
    if (left_ < 4 || !in_.read(reinterpret_cast<char*>(raw.data()), 4)) return Short();
    left_ -= 4;
    return raw[0] | (static_cast<uint32_t>(raw[1]) << 8) | (static_cast<uint32_t>(raw[2]) << 16) |
           (static_cast<uint32_t>(raw[3]) << 24);
  }
  Status Skip(uint64_t bytes) {
    if (bytes > left_) return Short();
    left_ -= bytes;
    in_.seekg(static_cast<std::streamoff>(bytes), std::ios::cur);
    return in_ ? OkStatus() : Short();
  }
  StatusOr<std::string> Name() {
    std::string name;
    for (int c = in_.get(); c != 0; c = in_.get()) {
      if (c < 0 || name.size() >= kMaxName) {
        return InvalidArgument("{}: a name in its EXR header does not end", path_);
      }
      name.push_back(static_cast<char>(c));
    }
    if (name.size() + 1 > left_) return Short();
    left_ -= name.size() + 1;
    return name;
  }
  Status Value(const std::string& type, uint32_t size);
  Status Channels(uint32_t size);

  std::string path_;
  std::ifstream in_;
  uint64_t left_;
};

Status Scanner::Begin(bool& multi_part) {
  MESORIG_ASSIGN_OR_RETURN(const uint32_t magic, U32());
  if (magic != kMagic) return InvalidArgument("{}: is not an OpenEXR file", path_);
  MESORIG_ASSIGN_OR_RETURN(const uint32_t version, U32());
  if ((version & 0xff) != 2) {
    return InvalidArgument("{}: EXR version {}, only 2 is read", path_, version & 0xff);
  }
  if ((version & (kNonImage | kTiled)) != 0) {
    return InvalidArgument("{}: holds tiles or deep data, only scan lines are read", path_);
  }
  multi_part = (version & kMultiPart) != 0;
  return OkStatus();
}

Status Scanner::Channels(uint32_t size) {
  uint64_t used = 0;
  while (true) {
    MESORIG_ASSIGN_OR_RETURN(const std::string name, Name());
    used += name.size() + 1;
    if (name.empty()) break;
    MESORIG_RETURN_IF_ERROR(Skip(16));
    used += 16;
    if (used > size) break;
  }
  if (used != size) return InvalidArgument("{}: its list of channels is damaged", path_);
  return OkStatus();
}

Status Scanner::Value(const std::string& type, uint32_t size) {
  if (type == "chlist") return Channels(size);
  const auto fixed = std::find_if(kFixed.begin(), kFixed.end(),
                                  [&](const FixedSize& entry) { return entry.type == type; });
  const bool known = fixed != kFixed.end() || type == "string" || type == "floatvector";
  if (!known) {
    return InvalidArgument("{}: holds an EXR attribute of type `{}`, which no BTF file has", path_,
                           type.size() < 32 && std::all_of(type.begin(), type.end(),
                                                           [](unsigned char c) {
                                                             return c >= 32 && c < 127;
                                                           })
                               ? type
                               : "?");
  }
  if ((fixed != kFixed.end() && fixed->bytes != size) || (type == "floatvector" && size % 4 != 0)) {
    return InvalidArgument("{}: an EXR attribute of type `{}` with {} bytes", path_, type, size);
  }
  return Skip(size);
}

Status Scanner::Header(bool& end) {
  MESORIG_ASSIGN_OR_RETURN(std::string name, Name());
  end = name.empty();
  while (!name.empty()) {
    MESORIG_ASSIGN_OR_RETURN(const std::string type, Name());
    MESORIG_ASSIGN_OR_RETURN(const uint32_t size, U32());
    MESORIG_RETURN_IF_ERROR(Value(type, size));
    MESORIG_ASSIGN_OR_RETURN(name, Name());
  }
  return OkStatus();
}

}  // namespace

Status PrescanExr(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return NotFound("{}: no such file", path.string());
  if (!std::filesystem::is_regular_file(path, error)) {
    return InvalidArgument("{}: is not a file", path.string());
  }
  const uint64_t size = std::filesystem::file_size(path, error);
  if (error) return InvalidArgument("{}: {}", path.string(), error.message());
  Scanner scanner(path, size);
  bool multi_part = false, end = false;
  if (size < 8) return InvalidArgument("{}: is not an OpenEXR file", path.string());
  MESORIG_RETURN_IF_ERROR(scanner.Begin(multi_part));
  MESORIG_RETURN_IF_ERROR(scanner.Header(end));
  if (end) return InvalidArgument("{}: has no EXR header", path.string());
  while (multi_part && !end) MESORIG_RETURN_IF_ERROR(scanner.Header(end));
  return OkStatus();
}

}  // namespace mesorig::btf
