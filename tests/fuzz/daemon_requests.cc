// Requests to the Control and Frames services (requests.h), over real sessions on disk and a
// sequencer that only says yes. The sessions are called A (complete, with sweeps) and B (killed) in
// the input.

#include "tests/daemon/service/service_fixture.h"
#include "tests/fuzz/requests.h"

namespace mesorig::daemon {
namespace {

class Daemon {
 public:
  Daemon() {
    auto complete = Session::Create(root(), plan_, rig_).value();
    MESORIG_CHECK(AppendAll(*complete, plan_).ok());
    MESORIG_CHECK(complete->Finish(true, "", 1, 1, true).ok());
    a_ = complete->id();
    auto killed = Session::Create(root(), SmallPlan(rig_), rig_).value();
    MESORIG_CHECK(killed->Append(FrameOf(0, 0), PixelsOf(0, 0)).ok() && killed->Flush().ok());
    b_ = killed->id();
    killed.reset();
    service_ = DaemonService::Create(rig_, sequencer_, root()).value();
    runner_ = std::make_unique<fuzz::RequestRunner>(service_->services());
  }
  void Run(std::string text) {
    Replace(text, "SESSION_A", a_);
    Replace(text, "SESSION_B", b_);
    runner_->Run(text);
    Forget();
  }

 private:
  // What a Run began: the next input finds the daemon as this one did.
  void Forget() {
    const auto session = sequencer_.session();
    if (session == nullptr || session->Summary().end != SessionEnd::kOpen) return;
    MESORIG_CHECK(session->Finish(false, "the input ended", 0, 0, true).ok());
    sequencer_.SetStatus({});
    std::filesystem::remove_all(root() / session->id());
  }
  std::filesystem::path root() const { return scratch_.path() / "sessions"; }
  static void Replace(std::string& text, std::string_view name, const std::string& by) {
    for (size_t at = 0; (at = text.find(name, at)) != text.npos; at += by.size()) {
      text.replace(at, name.size(), by);
    }
  }

  fuzz::ScratchFolder scratch_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SweepingPlan(rig_);
  FakeSequencer sequencer_;
  std::string a_, b_;
  std::unique_ptr<DaemonService> service_;
  std::unique_ptr<fuzz::RequestRunner> runner_;
};

}  // namespace
}  // namespace mesorig::daemon

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static auto* const daemon = new mesorig::daemon::Daemon;  // gRPC's threads outlive main
  daemon->Run(std::string(mesorig::fuzz::View(data, size)));
  return 0;
}
