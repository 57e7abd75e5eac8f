#pragma once
// Spreads the calls of a function over threads. Each index writes what is its own, so that results do
// not depend on timing.

#include <functional>

namespace mesorig::world {

// Calls f(i) for every i, on `threads` threads (the caller's is one of them); returns when all are
// done. f must not throw.
void ParallelFor(int count, int threads, const std::function<void(int)>& f);

}  // namespace mesorig::world
