#include "daemon/service/daemon_service.h"

#include "daemon/service/control_service.h"
#include "daemon/service/convert.h"
#include "daemon/service/event_log.h"
#include "daemon/service/frames_service.h"
#include "daemon/service/session_store.h"

namespace mesorig::daemon {
namespace {

// What the sequencer's listener writes to. Shared with the listener: one call of it may still be
// under way when the service goes.
struct Books {
  explicit Books(std::filesystem::path sessions_root) : sessions(std::move(sessions_root)) {}
  SessionStore sessions;
  EventLog events;
};

class DaemonServiceImpl final : public DaemonService {
 public:
  DaemonServiceImpl(const Rig& rig, Sequencer& sequencer, std::filesystem::path sessions_root)
      : sequencer_(sequencer),
        books_(std::make_shared<Books>(std::move(sessions_root))),
        control_(rig, sequencer, books_->sessions, books_->events),
        frames_(books_->sessions) {
    sequencer.OnEvent([books = books_](const SequencerEvent& event) {
      const uint32_t planned = books->sessions.FramesPlanned(event.status.session_id);
      books->events.Append(ToMessage(event, planned));
    });
  }
  ~DaemonServiceImpl() override { sequencer_.OnEvent(nullptr); }

  std::vector<grpc::Service*> services() override { return {&control_, &frames_}; }
  void ReportFault(std::string_view reason) override { control_.ReportFault(reason); }
  void BeginShutdown() override {
    control_.BeginShutdown();
    frames_.BeginShutdown();
    books_->events.Close();
  }

 private:
  Sequencer& sequencer_;
  const std::shared_ptr<Books> books_;
  ControlService control_;
  FramesService frames_;
};

}  // namespace

std::unique_ptr<DaemonService> DaemonService::Create(const Rig& rig, Sequencer& sequencer,
                                                     std::filesystem::path sessions_root) {
  return std::make_unique<DaemonServiceImpl>(rig, sequencer, std::move(sessions_root));
}

}  // namespace mesorig::daemon
