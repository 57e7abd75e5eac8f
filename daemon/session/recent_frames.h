#pragma once
// The frames that became durable last, still in memory: a consumer that keeps up takes them from
// here and nothing is read back from the disk. One that has fallen behind reads its segment.

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/mutex.h"

namespace mesorig::daemon {

inline constexpr size_t kRecentBytes = size_t{64} << 20;  // of all cameras: 85 frames of 1024 x 768

// Any thread.
class RecentFrames {
 public:
  // Holds about `max_bytes` of pixels, each camera its share.
  RecentFrames(size_t cameras, size_t max_bytes);
  // A camera's sequences ascend by one; a gap forgets what was before.
  void Add(const FrameRecord& record, std::shared_ptr<const std::string> pixels) EXCLUDES(mutex_);
  std::optional<StoredFrame> Find(int camera, uint64_t sequence) const EXCLUDES(mutex_);
  void Clear() EXCLUDES(mutex_);

 private:
  struct Camera {
    std::deque<StoredFrame> frames;  // ascending by one
    size_t bytes = 0;
  };
  const size_t max_bytes_;  // of one camera
  mutable Mutex mutex_;
  std::vector<Camera> cameras_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
