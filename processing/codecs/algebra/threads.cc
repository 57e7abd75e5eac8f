#include "processing/codecs/algebra/threads.h"

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace mesorig::codecs::algebra {
namespace {

constexpr int kMostThreads = 8;

std::atomic<int>& Count() {
  static std::atomic<int> count =
      std::clamp(static_cast<int>(std::thread::hardware_concurrency()), 1, kMostThreads);
  return count;
}

thread_local bool is_worker = false;

}  // namespace

void SetThreads(int threads) { Count() = std::max(threads, 1); }
int Threads() { return is_worker ? 1 : Count().load(); }

void OnWorkers(int workers, const std::function<void(int)>& work) {
  if (workers <= 1 || is_worker) {
    for (int i = 0; i < workers; ++i) work(i);
    return;
  }
  std::vector<std::thread> threads;
  for (int i = 1; i < workers; ++i) {
    threads.emplace_back([&work, i] {
      is_worker = true;
      work(i);
    });
  }
  is_worker = true;
  work(0);
  is_worker = false;
  for (std::thread& thread : threads) thread.join();
}

Status ForParts(int workers, int64_t size, int64_t part,
                const std::function<Status(int, int64_t, int64_t)>& function) {
  part = std::max<int64_t>(part, 1);
  const int64_t parts = (size + part - 1) / part;
  workers = static_cast<int>(std::clamp<int64_t>(workers, 1, std::max<int64_t>(parts, 1)));
  std::vector<Status> statuses(static_cast<size_t>(workers), OkStatus());
  std::vector<int64_t> ends(statuses.size(), parts);  // where each one's error is
  OnWorkers(workers, [&](int worker) {
    const auto w = static_cast<size_t>(worker);
    for (int64_t p = worker; p < parts && statuses[w].ok(); p += workers) {
      statuses[w] = function(worker, p * part, std::min(part, size - p * part));
      if (!statuses[w].ok()) ends[w] = p;
    }
  });
  const auto first = std::min_element(ends.begin(), ends.end()) - ends.begin();
  return statuses[static_cast<size_t>(first)];
}

}  // namespace mesorig::codecs::algebra
