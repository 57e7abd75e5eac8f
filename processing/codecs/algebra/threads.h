#pragma once
// The threads of the encoders. BLAS itself always runs on the thread that calls it: its own threads
// wait for each other by spinning, which is slow where cores are shared, and cannot be told apart by
// caller.

#include <cstdint>
#include <functional>

#include "protocol/base/status.h"

namespace mesorig::codecs::algebra {

// For the whole process; the number of cores (at most 8) until it is set. At least 1.
void SetThreads(int threads);
int Threads();

// Calls work(0), ..., work(workers - 1), each on a thread of its own where `workers` > 1. Workers that
// call it in turn do everything themselves.
void OnWorkers(int workers, const std::function<void(int)>& work);

// Calls function(worker, first, count) for the parts of [0, size) of `part` at most, worker w the parts
// w, w + workers, ...: the same parts on every run. The error of the first part that has one, after
// which its worker stops.
Status ForParts(int workers, int64_t size, int64_t part,
                const std::function<Status(int, int64_t, int64_t)>& function);

}  // namespace mesorig::codecs::algebra
