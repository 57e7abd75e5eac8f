#pragma once
// Unix stream sockets as owned values, with whole-message sends.

#include <filesystem>
#include <string_view>
#include <utility>

#include "protocol/base/status.h"

namespace mesorig::sim_wire {

// Owns a file descriptor; movable.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(other.Release()) {}
  Fd& operator=(Fd&& other) noexcept;
  ~Fd() { Close(); }
  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }
  int Release() { return std::exchange(fd_, -1); }
  void Close();

 private:
  int fd_ = -1;
};

StatusOr<Fd> Listen(const std::filesystem::path& path);
StatusOr<Fd> Connect(const std::filesystem::path& path);
// Sends all bytes; Unavailable when the peer is gone or takes nothing for `timeout_ms` host time.
Status SendAll(int fd, std::string_view bytes, int timeout_ms);
// Up to `size` bytes into `buffer`; 0 at the end of the stream.
StatusOr<size_t> ReceiveSome(int fd, char* buffer, size_t size);

}  // namespace mesorig::sim_wire
