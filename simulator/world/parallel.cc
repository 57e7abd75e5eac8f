#include "simulator/world/parallel.h"

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace mesorig::world {

void ParallelFor(int count, int threads, const std::function<void(int)>& f) {
  std::atomic<int> next{0};
  const auto work = [&] {
    for (int i = next++; i < count; i = next++) f(i);
  };
  std::vector<std::thread> helpers;
  for (int t = 1; t < std::min(threads, count); ++t) helpers.emplace_back(work);
  work();
  for (std::thread& helper : helpers) helper.join();
}

}  // namespace mesorig::world
