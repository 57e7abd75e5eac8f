#pragma once
// The daemon as its clients see it. Thread-safe; Watch blocks its caller.

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "protocol/base/status.h"
#include "protocol/messages/control.pb.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/wire/channel.h"

namespace mesorig::client {

class DaemonClient {
 public:
  // Finds mesorigd in the runtime directory or over the network, and shakes hands. Unavailable: it is not running or
  // does not answer; FailedPrecondition: it speaks another major version.
  static StatusOr<std::unique_ptr<DaemonClient>> Connect(const wire::Address& address);
  ~DaemonClient();

  const v1::HelloReply& hello() const;
  StatusOr<v1::RunReply> Run(std::string_view plan_toml, std::string_view plan_name);
  StatusOr<v1::StatusReply> GetStatus();
  Status Stop(std::string_view reason);
  StatusOr<v1::RunReply> Arm(std::string_view plan_toml, std::string_view plan_name);
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
  // Events above `after_sequence`, then as they happen, until `on_event` returns false (OK) or the
  // stream breaks (Unavailable).
  Status Watch(uint64_t after_sequence, const std::function<bool(const v1::Event&)>& on_event);

 private:
  struct State;
  explicit DaemonClient(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mesorig::client
