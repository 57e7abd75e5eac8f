#pragma once
// One process at a time: a lock on a small file that names who has it. The kernel gives it back when
// the process ends, however it ends.

#include <filesystem>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig {

class FileClaim {
 public:
  // Creates `file` if need be (its folder must exist). FailedPrecondition: "`taken` (process N)"
  // while another process holds it; InvalidArgument when the file cannot be opened.
  static StatusOr<FileClaim> Take(const std::filesystem::path& file, std::string_view taken);
  FileClaim(FileClaim&& other) noexcept;
  FileClaim& operator=(FileClaim&&) = delete;
  ~FileClaim();  // the file stays, so that nobody locks a ghost

 private:
  explicit FileClaim(int fd) : fd_(fd) {}
  int fd_ = -1;
};

}  // namespace mesorig
