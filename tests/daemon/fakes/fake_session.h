#pragma once
// A session in memory.

#include <mutex>
#include <string>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/digest.h"

namespace mesorig::daemon {

class FakeSession final : public Session {
 public:
  Status append_result, flush_result, finish_result;

  const std::string& id() const override { return id_; }
  const std::string& rig_toml() const override { return empty_; }
  const std::string& plan_bin() const override { return empty_; }
  SessionSummary Summary() const override {
    std::lock_guard lock(mutex_);
    return summary_;
  }
  Status Append(FrameRecord record, std::shared_ptr<const std::string> pixels) override {
    MESORIG_RETURN_IF_ERROR(append_result);
    std::lock_guard lock(mutex_);
    record.bytes = pixels->size();
    record.digest = FrameDigest(*pixels);
    records_.push_back(std::move(record));
    ++summary_.frames_durable;
    if (on_durable_) on_durable_(summary_.frames_durable);
    return OkStatus();
  }
  Status Flush() override { return flush_result; }
  Status Finish(bool complete, std::string_view reason, double virtual_s, double wall_s,
                bool deterministic) override {
    std::lock_guard lock(mutex_);
    ++finishes_;
    summary_.end = complete ? SessionEnd::kComplete : SessionEnd::kIncomplete;
    summary_.reason = reason;
    summary_.virtual_s = virtual_s;
    summary_.wall_s = wall_s;
    summary_.deterministic = deterministic;
    return finish_result;
  }
  StatusOr<std::optional<StoredFrame>> Next(int, uint64_t, int) override {
    return Unimplemented("not read in these tests");
  }
  StatusOr<uint64_t> ReleaseSweep(uint32_t) override {
    return Unimplemented("not released in these tests");
  }
  void OnDurable(std::function<void(uint32_t)> listener) override {
    std::lock_guard lock(mutex_);
    on_durable_ = std::move(listener);
  }
  std::vector<FrameRecord> records() const {
    std::lock_guard lock(mutex_);
    return records_;
  }
  int finishes() const {
    std::lock_guard lock(mutex_);
    return finishes_;
  }

 private:
  const std::string id_ = "session", empty_;
  mutable std::mutex mutex_;
  SessionSummary summary_;
  std::vector<FrameRecord> records_;
  int finishes_ = 0;
  std::function<void(uint32_t)> on_durable_;
};

}  // namespace mesorig::daemon
