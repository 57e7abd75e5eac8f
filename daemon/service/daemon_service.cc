#include "daemon/service/daemon_service.h"

#include "daemon/service/books.h"
#include "daemon/service/control_service.h"
#include "daemon/service/convert.h"
#include "daemon/service/frames_service.h"
#include "daemon/service/operations_service.h"

namespace mesorig::daemon {
namespace {

class DaemonServiceImpl final : public DaemonService {
 public:
  DaemonServiceImpl(const Rig& rig, Sequencer& sequencer, ManualControl* manual,
                    std::shared_ptr<Books> books)
      : sequencer_(sequencer),
        manual_(manual),
        books_(std::move(books)),
        control_(rig, sequencer, manual, *books_),
        frames_(*books_, [&sequencer] { return sequencer.GetStatus().now; }) {
    sequencer.OnEvent([books = books_](const SequencerEvent& event) {
      const uint32_t planned = books->sessions.FramesPlanned(event.status.session_id);
      books->events.Append(ToMessage(event, planned));
      if (event.kind == SequencerEvent::Kind::kEnded) books->EndSession(event);
    });
    if (manual != nullptr)
      manual->OnNote([books = books_](const std::string& note) {
        v1::Event event;
        event.set_note(note);
        books->events.Append(std::move(event));
      });
  }
  ~DaemonServiceImpl() override {
    sequencer_.OnEvent(nullptr);
    if (manual_ != nullptr) manual_->OnNote(nullptr);
    books_->lease->Close();  // its hooks call manual control
  }

  AuditLog& audit() override { return *books_->audit; }
  std::vector<grpc::Service*> services() override {
    return {&control_, &frames_, &operations_};
  }
  v1::StatusReply Status() const override { return control_.DescribeStatus(); }
  EventLog& events() override { return books_->events; }
  void OnDiagnose(std::function<std::vector<DiagnosticFile>()> collect) override {
    operations_.OnDiagnose(std::move(collect));
  }
  void ReportFault(std::string_view reason) override { control_.ReportFault(reason); }
  void BeginShutdown() override {
    control_.BeginShutdown();
    frames_.BeginShutdown();
    books_->events.Close();
  }

 private:
  Sequencer& sequencer_;
  ManualControl* const manual_;
  const std::shared_ptr<Books> books_;
  ControlService control_;
  FramesService frames_;
  OperationsService operations_;
};

}  // namespace

StatusOr<std::unique_ptr<DaemonService>> DaemonService::Create(const Rig& rig, Sequencer& sequencer,
                                                               std::filesystem::path state_dir,
                                                               ManualControl* manual) {
  MESORIG_ASSIGN_OR_RETURN(auto books, Books::Open(std::move(state_dir), manual, [&sequencer] {
                             return Seconds(sequencer.GetStatus().now);
                           }));
  return std::make_unique<DaemonServiceImpl>(rig, sequencer, manual, std::move(books));
}

}  // namespace mesorig::daemon
