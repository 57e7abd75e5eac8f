#pragma once
// The parts of bench_codecs. Each measures against a peer in the same run, on two threads, and returns
// its figures.

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "protocol/base/geometry.h"
#include "protocol/base/status.h"

namespace mesorig::bench {

inline constexpr int kThreads = 2;

// Decoding of view-svd, 4 terms of 128 x 128 x 96 x 96: random access and whole images, beside a triad
// over memory.
StatusOr<nlohmann::json> DecodeRates();
// Rank 32 of 12,288 x 16,384 beside scikit-learn's randomized_svd.
StatusOr<nlohmann::json> SvdBesideScikit(const std::filesystem::path& dir);

// view-svd of 128 x 128 x 96 x 96 from its file beside reading the file.
StatusOr<nlohmann::json> EncodeFromFile(const std::filesystem::path& dir);

// Every codec of the same file by strips, and the most memory that it holds.
StatusOr<nlohmann::json> PeaksOfStreams(const std::filesystem::path& dir);

// Every codec of 32 x 32 x 48 x 48 on one thread and on two, taking turns.
StatusOr<nlohmann::json> ThreadsOfEncoders();

inline double Seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}
inline double SecondsOnThreads(const std::function<void(int)>& work) {
  return Seconds([&] {
    std::vector<std::thread> threads;
    for (int i = 0; i < kThreads; ++i) threads.emplace_back(work, i);
    for (std::thread& thread : threads) thread.join();
  });
}
// The best of `rounds`: the machine may be doing other things too.
inline double Best(int rounds, const std::function<double()>& measure) {
  double best = measure();
  for (int i = 1; i < rounds; ++i) best = std::min(best, measure());
  return best;
}
// The pole and rings below it: `count` directions down to 75 degrees.
std::vector<Vec3> Directions(int count);

}  // namespace mesorig::bench
