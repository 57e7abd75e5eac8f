#pragma once
// A disk that fails, dies or loses power when a test says so.

#include <atomic>
#include <cerrno>
#include <fstream>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "protocol/base/disk_faults.h"
#include "protocol/base/mutex.h"

namespace mesorig {

class ScriptedDisk final : public DiskFaults {
 public:
  static constexpr uint64_t kNever = UINT64_MAX;

  // The n-th operation (from 0) on a path that contains `part`, and all such after it, fail with
  // `error` until Heal. Half of what a failing write should write gets there.
  void FailFrom(uint64_t n, int error, std::string part = "") {
    MutexLock lock(mutex_);
    fail_from_ = n;
    matching_ = 0;
    error_ = error;
    part_ = std::move(part);
  }
  void Heal() {
    MutexLock lock(mutex_);
    fail_from_ = kNever;
  }
  // The n-th operation does not happen (of a write, half of it does when `torn`), and nothing
  // after.
  void DieAt(uint64_t n, bool torn) {
    MutexLock lock(mutex_);
    die_at_ = n;
    torn_ = torn;
  }
  // Called before each operation, on the thread that does it.
  void OnAccess(std::function<void(const DiskAccess&)> hook) { hook_ = std::move(hook); }
  uint64_t operations() const {
    MutexLock lock(mutex_);
    return operations_;
  }
  bool is_dead() const {
    MutexLock lock(mutex_);
    return operations_ > die_at_;
  }

  int Before(const DiskAccess& access, uint64_t* torn) override {
    if (hook_) hook_(access);
    MutexLock lock(mutex_);
    const uint64_t n = operations_++;
    if (n >= die_at_) {
      if (n == die_at_ && torn_) *torn = access.bytes / 2;
      if (*torn > 0) Remember(access);
      return EIO;
    }
    const bool matches = access.path.string().find(part_) != std::string::npos;
    if (fail_from_ != kNever && matches && matching_++ >= fail_from_) {
      *torn = access.bytes / 2;
      return error_;
    }
    Remember(access);
    return 0;
  }

  // What was written and not synced is there or not, each piece by chance: the old bytes, or
  // garbage where there were none. Call when nobody writes any more.
  void CutPower(uint32_t seed) {
    MutexLock lock(mutex_);
    std::mt19937 random(seed);
    for (auto& [path, pieces] : unsynced_) {
      for (auto piece = pieces.rbegin(); piece != pieces.rend(); ++piece) {
        if (random() % 2 == 0) continue;
        std::string bytes = piece->old;
        while (bytes.size() < piece->bytes) bytes += static_cast<char>(random());
        std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
        file.seekp(static_cast<std::streamoff>(piece->offset));
        file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
      }
      std::error_code gone;
      if (!pieces.empty() && random() % 2 == 0) {  // nor did the file's new size get there
        std::filesystem::resize_file(path, pieces.front().size, gone);
      }
    }
    unsynced_.clear();
  }

 private:
  struct Piece {
    uint64_t offset = 0, bytes = 0, size = 0;  // size: of the file before
    std::string old;
  };
  void Remember(const DiskAccess& access) REQUIRES(mutex_) {
    if (access.operation == DiskOperation::kSync) unsynced_.erase(access.path.string());
    if (access.operation == DiskOperation::kRemove) unsynced_.erase(access.path.string());
    if (access.operation != DiskOperation::kWrite) return;
    Piece piece{access.offset, access.bytes, 0, {}};
    std::error_code error;
    piece.size = std::filesystem::file_size(access.path, error);
    if (error) piece.size = 0;
    std::ifstream file(access.path, std::ios::binary);
    file.seekg(static_cast<std::streamoff>(access.offset));
    piece.old.resize(access.bytes);
    file.read(piece.old.data(), static_cast<std::streamsize>(access.bytes));
    piece.old.resize(static_cast<size_t>(std::max<std::streamsize>(0, file.gcount())));
    unsynced_[access.path.string()].push_back(std::move(piece));
  }

  mutable Mutex mutex_;
  std::function<void(const DiskAccess&)> hook_;
  uint64_t operations_ GUARDED_BY(mutex_) = 0, matching_ GUARDED_BY(mutex_) = 0;
  uint64_t fail_from_ GUARDED_BY(mutex_) = kNever, die_at_ GUARDED_BY(mutex_) = kNever;
  int error_ GUARDED_BY(mutex_) = 0;
  bool torn_ GUARDED_BY(mutex_) = false;
  std::string part_ GUARDED_BY(mutex_);
  std::map<std::string, std::vector<Piece>> unsynced_ GUARDED_BY(mutex_);
};

}  // namespace mesorig
