#pragma once
// The services behind their access check on sockets of their own (the client is the administrator), over a sequencer that the test drives by hand.

#include <grpcpp/grpcpp.h>

#include <thread>

#include "daemon/service/access.h"
#include "daemon/service/daemon_service.h"
#include "protocol/base/mutex.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/messages/control.grpc.pb.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {

class FakeSequencer final : public Sequencer {
 public:
  Status CheckBegin(SequencerCommand how, const CompiledPlan&) override {
    MutexLock lock(mutex_);
    if (!early_refusal_.ok()) return early_refusal_;
    if (Allowed(status_.state, how)) return OkStatus();
    return FailedPrecondition("not possible while session {} is running", status_.session_id);
  }
  Status Begin(SequencerCommand how, SessionJob job) override {
    MutexLock lock(mutex_);
    if (!refusal_.ok()) return refusal_;
    status_.state =
        how == SequencerCommand::kArm ? SequencerState::kArmed : SequencerState::kRunning;
    status_.session_id = job.session->id();
    status_.shots = job.plan.shots;
    job_ = std::move(job);
    return OkStatus();
  }
  Status Command(SequencerCommand command, std::string_view reason) override {
    MutexLock lock(mutex_);
    commands_.emplace_back(
        fmt::format("{} {}", kCommandNames[static_cast<size_t>(command)], reason));
    return OkStatus();
  }
  Status Stop(std::string_view reason) override {
    MutexLock lock(mutex_);
    stopped_.emplace_back(reason);
    return OkStatus();
  }
  Status Acknowledge(uint32_t prompt_id) override {
    MutexLock lock(mutex_);
    if (!status_.prompt || status_.prompt->id != prompt_id)
      return FailedPrecondition("not that one");
    status_.prompt->acknowledged = true;
    return OkStatus();
  }
  SequencerStatus GetStatus() const override {
    MutexLock lock(mutex_);
    return status_;
  }
  void OnEvent(std::function<void(const SequencerEvent&)> listener) override {
    MutexLock lock(mutex_);
    listener_ = std::move(listener);
  }

  void Emit(SequencerEvent event) {
    event.status = GetStatus();
    std::function<void(const SequencerEvent&)> listener;
    {
      MutexLock lock(mutex_);
      listener = listener_;
    }
    if (listener) listener(event);
  }
  void Refuse(Status refusal) {
    MutexLock lock(mutex_);
    refusal_ = std::move(refusal);
  }
  void RefuseEarly(Status refusal) {
    MutexLock lock(mutex_);
    early_refusal_ = std::move(refusal);
  }
  void SetStatus(SequencerStatus status) {
    MutexLock lock(mutex_);
    status_ = std::move(status);
  }
  std::shared_ptr<Session> session() const {
    MutexLock lock(mutex_);
    return job_.session;
  }
  SessionJob job() const {
    MutexLock lock(mutex_);
    return job_;
  }
  // Lets go of the session, as the real one does at its end.
  void Release() {
    MutexLock lock(mutex_);
    job_.session.reset();
    status_ = {};
  }
  CompiledPlan plan() const {
    MutexLock lock(mutex_);
    return job_.plan;
  }
  std::vector<std::string> commands() const {
    MutexLock lock(mutex_);
    return commands_;
  }
  std::vector<std::string> stopped() const {
    MutexLock lock(mutex_);
    return stopped_;
  }

 private:
  mutable Mutex mutex_;
  Status refusal_ GUARDED_BY(mutex_), early_refusal_ GUARDED_BY(mutex_);
  std::vector<std::string> commands_ GUARDED_BY(mutex_);
  SequencerStatus status_ GUARDED_BY(mutex_);
  SessionJob job_ GUARDED_BY(mutex_);  // as the real one holds it
  std::vector<std::string> stopped_ GUARDED_BY(mutex_);
  std::function<void(const SequencerEvent&)> listener_ GUARDED_BY(mutex_);
};

class ServiceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto endpoint = PublishedEndpoint::Claim(folder_.path() / "run", wire::kDaemonName);
    ASSERT_TRUE(endpoint.ok()) << endpoint.status();
    endpoint_ = std::make_unique<PublishedEndpoint>(*std::move(endpoint));
    auto service = DaemonService::Create(rig_, sequencer_, root(), manual_);
    ASSERT_TRUE(service.ok()) << service.status();
    service_ = *std::move(service);
    access_options_.audit = &service_->audit();
    auto access = Access::Create(access_options_, *endpoint_, service_->services());
    ASSERT_TRUE(access.ok()) << access.status();
    access_ = *std::move(access);
    auto channel = wire::ConnectTo(folder_.path() / "run", wire::kDaemonName);
    ASSERT_TRUE(channel.ok()) << channel.status();
    channel_ = *channel;
    control_ = v1::Control::NewStub(*channel);
    frames_ = v1::Frames::NewStub(*channel);
  }
  void TearDown() override {
    if (service_) service_->BeginShutdown();
    if (access_) access_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(5));
    access_.reset();
    service_.reset();  // it uses `manual_` until its end
  }
  std::filesystem::path root() const { return folder_.path() / "sessions"; }
  std::string PlanText() const {
    return "name = \"small\"\n[sample]\nname = \"s\"\n"
           "[product]\nwidth_px = 4\nheight_px = 4\npitch_mm = 1\nh_ref_mm = 4.5\n"
           "[[grid]]\nexposure_s = 0.02\n[grid.axes.turntable]\nangles_deg = [0]\n"
           "[grid.axes.light_arc]\nangles_deg = [30]\n";
  }
  grpc::Status Run(const std::string& plan, v1::RunReply* reply) {
    grpc::ClientContext context;
    v1::RunRequest request;
    request.set_plan_toml(plan);
    request.set_plan_name("test.toml");
    return control_->Run(&context, request, reply);
  }

  TemporaryFolder folder_;
  const Rig rig_ = SmallRig();
  FakeSequencer sequencer_;
  std::unique_ptr<PublishedEndpoint> endpoint_;
  ManualControl* manual_ = nullptr;  // before SetUp
  std::unique_ptr<DaemonService> service_;
  AccessOptions access_options_;  // before SetUp
  std::unique_ptr<Access> access_;
  std::shared_ptr<grpc::Channel> channel_;  // gRPC's own
  std::unique_ptr<v1::Control::Stub> control_;
  std::unique_ptr<v1::Frames::Stub> frames_;
};

}  // namespace mesorig::daemon
