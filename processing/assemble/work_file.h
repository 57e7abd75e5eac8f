#pragma once
// The assembler's working memory: a file of equal slots of floats, mapped. The kernel keeps in
// memory what fits and writes out the rest. Removed with the object.

#include <filesystem>
#include <span>

#include "protocol/base/status.h"

namespace mesorig::assemble {

// Slots may be written from several threads, one thread a slot. Neither copied nor assigned.
class WorkFile {
 public:
  // Reserves the space on disk: FailedPrecondition, with the bytes needed, when there is not
  // enough. An existing file is replaced.
  static StatusOr<WorkFile> Create(const std::filesystem::path& path, size_t slots,
                                   size_t floats_per_slot);
  WorkFile(WorkFile&& other) noexcept;
  WorkFile& operator=(WorkFile&&) = delete;
  ~WorkFile();
  std::span<float> Slot(size_t slot) const {
    return {data_ + slot * floats_per_slot_, floats_per_slot_};
  }

 private:
  WorkFile() = default;
  std::filesystem::path path_;
  float* data_ = nullptr;
  size_t bytes_ = 0, floats_per_slot_ = 0;
};

}  // namespace mesorig::assemble
