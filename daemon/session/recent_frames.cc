#include "daemon/session/recent_frames.h"

#include <algorithm>

namespace mesorig::daemon {

RecentFrames::RecentFrames(size_t cameras, size_t max_bytes)
    : max_bytes_(max_bytes / std::max<size_t>(cameras, 1)), cameras_(cameras) {}

void RecentFrames::Add(const FrameRecord& record, std::shared_ptr<const std::string> pixels) {
  MutexLock lock(mutex_);
  if (record.camera < 0 || static_cast<size_t>(record.camera) >= cameras_.size()) return;
  Camera& camera = cameras_[static_cast<size_t>(record.camera)];
  if (!camera.frames.empty() && camera.frames.back().record.sequence + 1 != record.sequence) {
    camera = Camera();
  }
  camera.bytes += pixels->size();
  camera.frames.push_back({record, std::move(pixels)});
  while (camera.bytes > max_bytes_) {
    camera.bytes -= camera.frames.front().pixels->size();
    camera.frames.pop_front();
  }
}

std::optional<StoredFrame> RecentFrames::Find(int camera, uint64_t sequence) const {
  MutexLock lock(mutex_);
  if (camera < 0 || static_cast<size_t>(camera) >= cameras_.size()) return std::nullopt;
  const std::deque<StoredFrame>& frames = cameras_[static_cast<size_t>(camera)].frames;
  if (frames.empty() || sequence < frames.front().record.sequence ||
      sequence > frames.back().record.sequence) {
    return std::nullopt;
  }
  return frames[sequence - frames.front().record.sequence];
}

void RecentFrames::Clear() {
  MutexLock lock(mutex_);
  for (Camera& camera : cameras_) camera = Camera();
}

}  // namespace mesorig::daemon
