#pragma once
// A lamp bank on a serial line: a Modbus RTU slave at a pseudo-terminal, written from the
// specification (Modbus over serial line V1.02, 2.5.1) without libmodbus, that can answer wrongly.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "protocol/base/unique_fd.h"

namespace mesorig::daemon {

// CRC-16 of polynomial 0xA001, low byte first (6.2.2).
inline std::string WithCrc(std::string frame) {
  unsigned crc = 0xFFFF;
  for (const char byte : frame) {
    crc ^= static_cast<uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1) != 0 ? crc >> 1 ^ 0xA001 : crc >> 1;
  }
  frame += static_cast<char>(crc & 0xFF);
  frame += static_cast<char>(crc >> 8);
  return frame;
}

class PtySlave {
 public:
  // What goes out instead of a right answer; empty: nothing does.
  using Meddler = std::function<std::string(std::string answer)>;

  explicit PtySlave(uint8_t unit) : unit_(unit) {
    static std::atomic<int> count{0};
    link_ = std::filesystem::temp_directory_path() /
            ("mesorig-tty-" + std::to_string(::getpid()) + "-" + std::to_string(count++));
    PlugIn();
  }
  ~PtySlave() {
    HangUp();
    std::filesystem::remove(link_);
  }
  std::string device() const { return link_.string(); }
  // The adapter is in again: another terminal behind the same name.
  void PlugIn() {
    master_ = UniqueFd(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
    ASSERT_EQ(::grantpt(master_.get()), 0);
    ASSERT_EQ(::unlockpt(master_.get()), 0);
    termios raw{};
    ASSERT_EQ(::tcgetattr(master_.get(), &raw), 0);
    ::cfmakeraw(&raw);
    ASSERT_EQ(::tcsetattr(master_.get(), TCSANOW, &raw), 0);
    std::filesystem::remove(link_);
    std::filesystem::create_symlink(::ptsname(master_.get()), link_);
    wake_ = UniqueFd(::eventfd(0, EFD_CLOEXEC));
    thread_ = std::thread([this] { Serve(); });
  }
  // The adapter is out: its users read the end.
  void HangUp() {
    if (!thread_.joinable()) return;
    const uint64_t one = 1;
    ASSERT_EQ(::write(wake_.get(), &one, sizeof(one)), static_cast<ssize_t>(sizeof(one)));
    thread_.join();
    std::filesystem::remove(link_);
    master_.Close();
  }
  void Meddle(Meddler meddler) {
    const std::lock_guard lock(mutex_);
    meddler_ = std::move(meddler);
  }
  std::array<bool, 16> coils() {
    const std::lock_guard lock(mutex_);
    return coils_;
  }
  int requests() const { return requests_; }
  // Of requests whose CRC was wrong.
  int damaged() const { return damaged_; }

 private:
  void Serve() {
    std::string bytes;
    for (;;) {
      pollfd ready[] = {{wake_.get(), POLLIN, 0}, {master_.get(), POLLIN, 0}};
      ::poll(ready, 2, -1);
      if (ready[0].revents != 0) return;
      char buffer[512];
      const ssize_t got = ::read(master_.get(), buffer, sizeof(buffer));
      if (got <= 0) {  // nobody has it open
        ::usleep(1000);
        bytes.clear();
        continue;
      }
      bytes.append(buffer, static_cast<size_t>(got));
      while (!bytes.empty() && bytes.size() >= SizeOf(bytes)) {
        const std::string request = bytes.substr(0, SizeOf(bytes));
        bytes.erase(0, request.size());
        Answer(request);
      }
    }
  }
  static uint8_t Byte(const std::string& bytes, size_t i) { return static_cast<uint8_t>(bytes[i]); }
  static size_t SizeOf(const std::string& bytes) {
    if (bytes.size() < 7) return 8;
    return Byte(bytes, 1) == 0x0F ? 9u + Byte(bytes, 6) : 8u;
  }
  void Answer(const std::string& request) {
    ++requests_;
    const std::string body = request.substr(0, request.size() - 2);
    if (WithCrc(body) != request) {
      ++damaged_;
      return;
    }
    if (Byte(body, 0) != unit_) return;
    const std::lock_guard lock(mutex_);
    std::string answer = WithCrc(Reply(body));
    if (meddler_) answer = meddler_(std::move(answer));
    for (size_t sent = 0; sent < answer.size();) {
      const ssize_t n = ::write(master_.get(), answer.data() + sent, answer.size() - sent);
      if (n <= 0) return;
      sent += static_cast<size_t>(n);
    }
  }
  std::string Reply(const std::string& body) {
    const uint8_t function = Byte(body, 1);
    const size_t first = Byte(body, 2) * 256u + Byte(body, 3);
    const size_t count = Byte(body, 4) * 256u + Byte(body, 5);
    std::string reply = body.substr(0, 2);
    if (first + count > coils_.size()) {
      reply[1] = static_cast<char>(function | 0x80);
      return reply + '\2';  // illegal data address
    }
    if (function == 0x0F) {
      for (size_t i = 0; i < count; ++i) {
        coils_[first + i] = (Byte(body, 7 + i / 8) >> i % 8 & 1) != 0;
      }
      return body.substr(0, 6);
    }
    if (function == 0x01) {
      std::string bits((count + 7) / 8, '\0');
      for (size_t i = 0; i < count; ++i) {
        if (coils_[first + i]) bits[i / 8] = static_cast<char>(bits[i / 8] | 1 << i % 8);
      }
      return reply + static_cast<char>(bits.size()) + bits;
    }
    std::string registers;  // 0x04: full flux where a coil is on
    for (size_t i = 0; i < count; ++i) {
      const int flux = coils_[first + i] ? 1000 : 0;
      registers += {static_cast<char>(flux >> 8), static_cast<char>(flux & 0xFF)};
    }
    return reply + static_cast<char>(registers.size()) + registers;
  }

  const uint8_t unit_;
  std::filesystem::path link_;
  UniqueFd master_, wake_;
  std::thread thread_;
  std::atomic<int> requests_{0}, damaged_{0};
  std::mutex mutex_;
  std::array<bool, 16> coils_{};  // guarded by mutex_
  Meddler meddler_;               // likewise
};

}  // namespace mesorig::daemon
