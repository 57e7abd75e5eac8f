#pragma once
// The daemon as its clients see it. Thread-safe; Watch blocks its caller.

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/messages/control.pb.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/messages/operations.pb.h"
#include "protocol/wire/channel.h"

namespace mesorig::client {

class DaemonClient {
 public:
  // Finds mesorigd in the runtime directory or over the network, and shakes hands. Unavailable: it is not running or
  // does not answer; FailedPrecondition: it speaks another major version.
  static StatusOr<std::unique_ptr<DaemonClient>> Connect(const wire::Address& address);
  ~DaemonClient();

  const v1::HelloReply& hello() const;
  // lease_token: 0 when nobody has the lease.
  StatusOr<v1::RunReply> Run(std::string_view plan_toml, std::string_view plan_name,
                             uint64_t lease_token = 0);
  StatusOr<v1::StatusReply> GetStatus();
  Status Stop(std::string_view reason);
  StatusOr<v1::RunReply> Arm(std::string_view plan_toml, std::string_view plan_name,
                             uint64_t lease_token = 0);
  Status Start();
  Status Pause(bool now, std::string_view reason);
  Status Continue();
  Status Abort(std::string_view reason);
  Status Reset();
  StatusOr<v1::RunReply> ResumeSession(const v1::ResumeSessionRequest& request);
  // The operator has done what this prompt asks for.
  Status Acknowledge(uint32_t prompt_id);
  StatusOr<v1::ListSessionsReply> ListSessions();
  StatusOr<v1::SessionReply> GetSession(std::string_view session_id);
  // The latest events, at most `count`, oldest first; none when they cannot be had.
  std::vector<v1::Event> LastEvents(const v1::StatusReply& status, size_t count);
  // What the daemon tells somebody who helps.
  StatusOr<v1::DiagnoseReply> Diagnose();
  // Events above `after_sequence` (of the daemon that Connect met), then as they happen, until
  // `on_event` returns false (OK). A stream that breaks is taken up again where it was, a daemon
  // that is gone waited for: Unavailable after `patience_s`. What is missed is told as a Gap.
  Status Watch(uint64_t after_sequence, const std::function<bool(const v1::Event&)>& on_event,
               double patience_s = 0);

  // The rig by hand (docs/lease.md).
  StatusOr<v1::LeaseStatus> AcquireLease(double span_s, bool take);
  StatusOr<v1::LeaseStatus> RenewLease(uint64_t token);
  StatusOr<v1::LeaseStatus> ReleaseLease(uint64_t token);
  StatusOr<v1::LeaseStatus> RequestHandover();
  // Tells `axis` every 50 ms to go on at this rate, as long as `held` says so; then it stops.
  Status Jog(uint64_t token, std::string_view axis, double rate_rad_s,
             const std::function<bool()>& held);
  // Return when it is done; when `leave` says so the call is given up, and the daemon stops it.
  Status MoveAxis(uint64_t token, std::string_view axis, double target_rad,
                  const std::function<bool()>& leave);
  Status HomeAxis(uint64_t token, std::string_view axis, const std::function<bool()>& leave);
  Status SetLamp(uint64_t token, std::string_view lamp);  // empty: none
  Status TestLaser(uint64_t token, double seconds, const std::function<bool()>& leave);
  // The audit log's bytes from `offset` on, piece by piece.
  Status ReadAudit(uint64_t offset, const std::function<void(std::string_view)>& on_bytes);

 private:
  struct State;
  explicit DaemonClient(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mesorig::client
