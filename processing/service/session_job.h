#pragma once
// Turns one session's frames into its products, as they arrive.

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>
#include <vector>

#include "processing/service/calls.h"
#include "processing/service/job_table.h"
#include "processing/service/session_products.h"
#include "protocol/base/mutex.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/messages/processing.pb.h"

namespace mesorig::service {

struct JobOptions {
  std::filesystem::path runtime_dir, products_dir;
  double patience_s = 30;  // how long the daemon may be away before the session is given up
};

// At most this many frames are computed at a time, of all sessions.
inline constexpr int kComputeThreads = 2;
using ComputeSlots = std::counting_semaphore<kComputeThreads>;

// One thread a camera reads the frames and computes them; each has a connection of its own and
// goes on from its cursor when the daemon was away. Runs on the host's clock: virtual time never
// waits for it. What was not packed when it ends is gone, but for displacement images of
// sweeps: a new job begins at the first frame, and needs no frames of these again.
class SessionJob final : public Job {
 public:
  // `on_change` is called, without a lock, whenever Snapshot() has changed for good (done or
  // failed). `slots` is borrowed.
  SessionJob(std::string session_id, JobOptions options, ComputeSlots& slots,
             std::function<void()> on_change);
  ~SessionJob() override;  // stops it and waits
  void Stop() override { stop_.Stop(); }
  v1::ProductsReply Snapshot() const override;
  bool finished() const override;
  bool failed() const override;
  uint32_t start() const override;

 private:
  using Clock = std::chrono::steady_clock;

  void Run();
  Status Process();
  StatusOr<v1::SessionReply> AskSession();
  Status ReadAllCameras(const std::vector<int>& cameras);
  Status ReadCamera(int camera);
  // Reads until the stream ends; `cursor` follows. Unavailable: the daemon went away.
  // `lamps_only` passes over frames of sweeps.
  Status ReadStream(int camera, uint64_t& cursor, Clock::time_point& last_sign, bool lamps_only);
  Status Take(int camera, const v1::Frame& frame);
  // Tells the daemon of sweeps whose raw frames may go. What it does not hear is told again.
  void ReleaseSweeps();
  StatusOr<v1::SessionReply> AwaitComplete();
  Status Pack(const std::string& audit_head);
  void Fail(const Status& status);

  const std::string session_id_;
  const JobOptions options_;
  ComputeSlots& slots_;
  const std::function<void()> on_change_;
  StopSignal stop_;
  Rig rig_;
  std::unique_ptr<SessionProducts> session_products_;  // from Process, before any reader starts

  mutable Mutex mutex_;
  v1::ProductsReply state_ GUARDED_BY(mutex_);
  bool failed_ GUARDED_BY(mutex_) = false;
  uint32_t start_ GUARDED_BY(mutex_) = 0;
  std::optional<Clock::time_point> first_frame_ GUARDED_BY(mutex_);
  double busy_s_ GUARDED_BY(mutex_) = 0;
  uint32_t received_ GUARDED_BY(mutex_) = 0;
  std::vector<uint32_t> to_release_ GUARDED_BY(mutex_);
  std::thread thread_;  // last: runs on the members above
};

}  // namespace mesorig::service
