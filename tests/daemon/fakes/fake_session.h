#pragma once
// A session in memory.

#include <algorithm>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "daemon/session/session.h"
#include "protocol/base/digest.h"

namespace mesorig::daemon {

class FakeSession final : public Session {
 public:
  Status append_result, flush_result, finish_result;
  // What the plan asks for: without it nothing is missing.
  void Expect(const CompiledPlan& plan) {
    std::lock_guard lock(mutex_);
    planned_.clear();
    for (const Step& step : plan.steps) {
      const bool sweep = step.kind == StepKind::kSweep;
      if (!sweep && step.kind != StepKind::kShot) continue;
      for (uint32_t i = 0; i < (sweep ? step.sweep.frames : 1); ++i) {
        planned_[step.shot + i] = {step.cameras.begin(), step.cameras.end()};
      }
    }
  }

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
    live_.insert({record.shot, record.camera});
    if (!record.laser) {
      reference_ = StoredFrame{record, pixels};
    }
    records_.push_back(std::move(record));
    ++summary_.frames_durable;
    if (on_durable_) on_durable_(summary_.frames_durable);
    return OkStatus();
  }
  std::vector<int> Missing(uint32_t shot) const override {
    std::lock_guard lock(mutex_);
    std::vector<int> missing;
    const auto planned = planned_.find(shot);
    if (planned == planned_.end()) return missing;
    for (const int camera : planned->second) {
      if (!live_.contains({shot, camera})) missing.push_back(camera);
    }
    return missing;
  }
  Status Record(JournalEntry entry) override {
    std::lock_guard lock(mutex_);
    if (entry.kind == JournalKind::kExposure) exposures_[entry.index] = entry.value;
    journal_.push_back(std::move(entry));
    return OkStatus();
  }
  std::optional<double> MeteredExposure(int meter) const override {
    std::lock_guard lock(mutex_);
    const auto found = exposures_.find(meter);
    return found == exposures_.end() ? std::nullopt : std::optional<double>(found->second);
  }
  StatusOr<std::optional<StoredFrame>> Reference() override {
    std::lock_guard lock(mutex_);
    return reference_;
  }
  // This frame is not there any more.
  void Lose(uint32_t shot, int camera) {
    std::lock_guard lock(mutex_);
    live_.erase({shot, camera});
  }
  // These frames turn out damaged at the next look.
  void Damage(uint32_t shot, int camera) {
    std::lock_guard lock(mutex_);
    damaged_.insert({shot, camera});
  }
  StatusOr<uint32_t> DropDamaged() override {
    std::lock_guard lock(mutex_);
    uint32_t dropped = 0;
    for (const auto& frame : damaged_) dropped += live_.erase(frame) > 0;
    damaged_.clear();
    return dropped;
  }
  // As if the disk were full, or had room again.
  void SetStorage(Status status) {
    std::function<void(const Status&)> listener;
    {
      std::lock_guard lock(mutex_);
      storage_ = status;
      listener = on_storage_;
    }
    if (listener) listener(status);
  }
  Status Storage() const override {
    std::lock_guard lock(mutex_);
    return storage_;
  }
  void OnStorage(std::function<void(const Status&)> listener) override {
    std::lock_guard lock(mutex_);
    on_storage_ = std::move(listener);
  }
  // The process was killed: the next run goes on with what is here.
  void Reopen() {
    std::lock_guard lock(mutex_);
    summary_.end = SessionEnd::kOpen;
    finishes_ = 0;
  }
  // The last frame was another one.
  void ReplaceReference(std::string pixels) {
    std::lock_guard lock(mutex_);
    reference_->pixels = std::make_shared<const std::string>(std::move(pixels));
  }
  size_t FramesQueued() const override { return 0; }
  uint64_t FramesVerified() const override { return 0; }
  StatusOr<std::vector<JournalEntry>> Entries() override { return journal(); }
  std::vector<JournalEntry> journal() const {
    std::lock_guard lock(mutex_);
    return journal_;
  }
  std::optional<LiveFrame> Latest(int, uint64_t, int) override { return std::nullopt; }
  int Journaled(JournalKind kind) const {
    std::lock_guard lock(mutex_);
    return static_cast<int>(std::count_if(journal_.begin(), journal_.end(),
                                          [&](const auto& entry) { return entry.kind == kind; }));
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
  std::map<uint32_t, std::set<int>> planned_;          // cameras of each shot
  std::set<std::pair<uint32_t, int>> live_, damaged_;  // shot, camera
  std::map<int, double> exposures_;
  std::optional<StoredFrame> reference_;
  std::vector<JournalEntry> journal_;
  Status storage_;
  std::function<void(const Status&)> on_storage_;
  int finishes_ = 0;
  std::function<void(uint32_t)> on_durable_;
};

}  // namespace mesorig::daemon
