#pragma once
// The sessions of a daemon and their frames, as its clients see them. Thread-safe; calls that
// stream block their caller.

#include <functional>
#include <memory>
#include <optional>
#include <string_view>

#include "protocol/base/status.h"
#include "protocol/messages/frames.pb.h"
#include "protocol/wire/channel.h"

namespace mesorig::client {

class FramesClient {
 public:
  // Finds mesorigd in the runtime directory. Unavailable: it is not running.
  static StatusOr<std::unique_ptr<FramesClient>> Connect(const wire::Address& address);
  ~FramesClient();

  StatusOr<v1::ListSessionsReply> ListSessions();
  StatusOr<v1::SessionReply> GetSession(std::string_view session_id);
  // `progress`: frames done, frames planned.
  StatusOr<v1::VerifyReport> Verify(std::string_view session_id,
                                    const std::function<void(uint32_t, uint32_t)>& progress);
  StatusOr<v1::JournalReply> ReadJournal(std::string_view session_id);
  StatusOr<v1::RemoveSessionReply> Remove(std::string_view session_id, bool complete_too);
  StatusOr<v1::CleanSessionsReply> Clean(std::optional<uint32_t> keep,
                                         std::optional<double> older_than_s, bool incomplete_too);
  // Frames of one camera from the first, until the session's last one that is there (OK, also of an
  // incomplete session), or `on_frame` fails.
  Status ReadFrames(std::string_view session_id, uint32_t camera,
                    const std::function<Status(const v1::Frame&)>& on_frame);
  // The next small picture of this camera; waits until there is one.
  StatusOr<v1::PreviewFrame> NextPreview(uint32_t camera);

 private:
  struct State;
  explicit FramesClient(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace mesorig::client
