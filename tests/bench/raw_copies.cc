#include "tests/bench/raw_copies.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <thread>

#include "protocol/base/check.h"
#include "tests/bench/consumer.h"

namespace mesorig::bench {

double RawWrite(const PatternSource& source, const std::vector<uint32_t>& groups,
                const std::filesystem::path& dir) {
  std::array<int, kCameras> files{};
  for (int camera = 0; camera < kCameras; ++camera) {
    const auto path = dir / std::to_string(camera);
    files[static_cast<size_t>(camera)] = ::open(path.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0644);
    MESORIG_CHECK(files[static_cast<size_t>(camera)] >= 0);
  }
  const auto began = std::chrono::steady_clock::now();
  uint32_t frame = 0;
  for (const uint32_t group : groups) {
    for (uint32_t i = 0; i < group; ++i, ++frame) {
      const auto camera = static_cast<int>(frame % kCameras);
      const std::string& pixels = *source.PixelsOf(frame / kCameras, camera);
      const ssize_t n = ::write(files[static_cast<size_t>(camera)], pixels.data(), pixels.size());
      MESORIG_CHECK(n == static_cast<ssize_t>(pixels.size()));
    }
    for (uint32_t i = 0; i < std::min<uint32_t>(group, kCameras); ++i) {
      MESORIG_CHECK(::fdatasync(files[(frame - 1 - i) % kCameras]) == 0);
    }
  }
  const double seconds = SecondsSince(began);
  for (const int file : files) ::close(file);
  return 1e-6 * static_cast<double>(source.frame_bytes()) * frame / seconds;
}

double RawSockets(const PatternSource& source, double bytes) {
  std::vector<int> ours, theirs;
  std::vector<std::string> arguments = {"drain"};
  for (int camera = 0; camera < kCameras; ++camera) {
    int ends[2];
    MESORIG_CHECK(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) == 0);
    ours.push_back(ends[0]), theirs.push_back(ends[1]);
    arguments.push_back(std::to_string(ends[1]));
  }
  Child consumer = Child::Start(arguments, theirs);
  for (const int fd : theirs) ::close(fd);
  const auto shots = static_cast<uint32_t>(bytes / static_cast<double>(source.shot_bytes()));
  const auto began = std::chrono::steady_clock::now();
  std::vector<std::thread> threads;
  for (int camera = 0; camera < kCameras; ++camera) {
    threads.emplace_back([&, camera] {
      const int fd = ours[static_cast<size_t>(camera)];
      for (uint32_t shot = 0; shot < shots; ++shot) {
        const std::string& pixels = *source.PixelsOf(shot, camera);
        for (size_t done = 0; done < pixels.size();) {
          const ssize_t n = ::write(fd, pixels.data() + done, pixels.size() - done);
          MESORIG_CHECK(n > 0);
          done += static_cast<size_t>(n);
        }
      }
      ::close(fd);
    });
  }
  for (std::thread& thread : threads) thread.join();
  const double received = consumer.Result()["bytes"];
  return 1e-6 * received / SecondsSince(began);
}

}  // namespace mesorig::bench
