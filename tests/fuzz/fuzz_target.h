#pragma once
// What the fuzz targets share. A target defines LLVMFuzzerTestOneInput and asserts with
// MESORIG_CHECK; what it must never do beside that is crash, hang or take memory without end.

#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "protocol/base/check.h"

namespace mesorig::fuzz {

// A folder of this process, below TMPDIR (tests/fuzz/run puts it into memory: targets write files
// for each input).
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "mesorig-fuzz-XXXXXX").string();
    MESORIG_CHECK(::mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline std::filesystem::path Source(std::string_view path) {
  return std::filesystem::path(MESORIG_SOURCE_DIR) / path;
}

inline void Overwrite(const std::filesystem::path& path, std::string_view bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string_view View(const uint8_t* data, size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

// Cuts `text` up to and with the next `separator` off; all of it when there is none.
inline std::string_view TakeUntil(std::string_view& text, std::string_view separator) {
  const size_t at = text.find(separator);
  const std::string_view head = text.substr(0, at);
  text = at == text.npos ? std::string_view() : text.substr(at + separator.size());
  return head;
}

}  // namespace mesorig::fuzz
