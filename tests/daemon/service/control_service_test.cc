#include "tests/daemon/service/service_fixture.h"

namespace mesorig::daemon {
namespace {

using ControlServiceTest = ServiceTest;

TEST_F(ControlServiceTest, HelloRefusesAnotherMajorVersion) {
  v1::HelloRequest request;
  v1::HelloReply reply;
  request.set_client("test 1");
  request.set_protocol_major(wire::kProtocolMajor);
  {
    grpc::ClientContext context;
    ASSERT_TRUE(control_->Hello(&context, request, &reply).ok());
  }
  EXPECT_EQ(reply.rig_name(), "demo");
  EXPECT_EQ(reply.rig_sha256(), rig_.sha256);
  request.set_protocol_major(wire::kProtocolMajor + 1);
  grpc::ClientContext context;
  const grpc::Status status = control_->Hello(&context, request, &reply);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("test 1 speaks protocol version 2"), std::string::npos)
      << status.error_message();
}

TEST_F(ControlServiceTest, RunStartsASession) {
  v1::RunReply reply;
  const grpc::Status status = Run(PlanText(), &reply);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(reply.shots(), 8u);
  EXPECT_EQ(reply.frames(), 64u);
  EXPECT_EQ(reply.frame_bytes(), 64u * 128);
  EXPECT_GT(reply.estimated_s(), 0);
  ASSERT_NE(sequencer_.session(), nullptr);
  EXPECT_EQ(sequencer_.session()->id(), reply.session_id());
  EXPECT_EQ(PackPlan(sequencer_.plan()), sequencer_.session()->plan_bin());
  EXPECT_TRUE(std::filesystem::exists(root() / reply.session_id() / "plan.bin"));
  // A second one while it runs: refused, and nothing on the disk.
  const grpc::Status second = Run(PlanText(), &reply);
  EXPECT_EQ(second.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_NE(second.error_message().find(reply.session_id()), std::string::npos);
  EXPECT_EQ(ListSessions(root())->size(), 1u);
}

TEST_F(ControlServiceTest, AWrongPlanNamesItsPlace) {
  v1::RunReply reply;
  const grpc::Status status = Run(PlanText() + "speed = 3\n", &reply);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(status.error_message().starts_with("test.toml:15:1: unknown key"))
      << status.error_message();
  EXPECT_TRUE(ListSessions(root())->empty());
}

TEST_F(ControlServiceTest, ARefusedStartLeavesNoSession) {
  sequencer_.Refuse(FailedPrecondition("the door is open"));
  v1::RunReply reply;
  const grpc::Status status = Run(PlanText(), &reply);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(status.error_message(), "the door is open");
  EXPECT_TRUE(ListSessions(root())->empty());
  sequencer_.Refuse(OkStatus());
  sequencer_.RefuseEarly(FailedPrecondition("the door is open"));
  EXPECT_EQ(Run(PlanText(), &reply).error_message(), "the door is open");
  EXPECT_TRUE(ListSessions(root())->empty());
}

TEST_F(ControlServiceTest, StatusCarriesReadingsWithTheirAge) {
  v1::RunReply run;
  ASSERT_TRUE(Run(PlanText(), &run).ok());
  SequencerStatus status = sequencer_.GetStatus();
  status.now = FromSeconds(100);
  status.shots_done = 3;
  status.frames_durable = 17;
  status.readings = {{"lamp lamp3", "1", 0.75, FromSeconds(98.5)}};
  sequencer_.SetStatus(status);
  grpc::ClientContext context;
  v1::StatusReply reply;
  ASSERT_TRUE(control_->GetStatus(&context, v1::StatusRequest(), &reply).ok());
  EXPECT_EQ(reply.state(), v1::RUNNING);
  EXPECT_EQ(reply.session_id(), run.session_id());
  EXPECT_EQ(reply.shots_done(), 3u);
  EXPECT_EQ(reply.frames_durable(), 17u);
  EXPECT_EQ(reply.frames(), 64u);
  ASSERT_EQ(reply.readings_size(), 1);
  EXPECT_EQ(reply.readings(0).name(), "lamp lamp3");
  EXPECT_EQ(reply.readings(0).value(), 0.75);
  EXPECT_DOUBLE_EQ(reply.readings(0).age_s(), 1.5);
}

TEST_F(ControlServiceTest, APromptIsShownAndAcknowledged) {
  SequencerStatus waiting;
  waiting.state = SequencerState::kWaiting;
  waiting.prompt = OperatorPrompt{3, "Mount the laser", "slant", false, true, false};
  sequencer_.SetStatus(waiting);
  v1::StatusReply status;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(control_->GetStatus(&context, v1::StatusRequest(), &status).ok());
  }
  EXPECT_EQ(status.state(), v1::WAITING);
  EXPECT_EQ(status.prompt().id(), 3u);
  EXPECT_EQ(status.prompt().mount(), "slant");
  EXPECT_TRUE(status.prompt().door_cycled());
  EXPECT_FALSE(status.prompt().acknowledged());
  v1::AcknowledgeRequest request;
  v1::AcknowledgeReply reply;
  request.set_prompt_id(2);
  {
    grpc::ClientContext context;
    EXPECT_EQ(control_->Acknowledge(&context, request, &reply).error_code(),
              grpc::StatusCode::FAILED_PRECONDITION);
  }
  request.set_prompt_id(3);
  grpc::ClientContext context;
  EXPECT_TRUE(control_->Acknowledge(&context, request, &reply).ok());
  EXPECT_TRUE(sequencer_.GetStatus().prompt->acknowledged);
  // A plan that waits is a plan that runs: no second one.
  v1::RunReply run;
  EXPECT_EQ(Run(PlanText(), &run).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(ControlServiceTest, WatchReplaysAndFollows) {
  v1::RunReply run;
  ASSERT_TRUE(Run(PlanText(), &run).ok());
  SequencerEvent started;
  started.kind = SequencerEvent::Kind::kStarted;
  sequencer_.Emit(started);
  SequencerEvent note;
  note.text = "camera cam3 owed a frame";
  sequencer_.Emit(note);
  grpc::ClientContext context;
  v1::WatchRequest request;
  request.set_after_sequence(run.event_sequence());
  request.set_life(run.life());
  const auto stream = control_->Watch(&context, request);
  v1::Event event;
  ASSERT_TRUE(stream->Read(&event));
  EXPECT_EQ(event.sequence(), run.event_sequence() + 1);
  EXPECT_EQ(event.started().session_id(), run.session_id());
  EXPECT_EQ(event.started().frames(), 64u);
  ASSERT_TRUE(stream->Read(&event));
  EXPECT_EQ(event.note(), "camera cam3 owed a frame");
  SequencerEvent ended;
  ended.kind = SequencerEvent::Kind::kEnded;
  ended.text = "the door was opened";
  ended.virtual_s = 8;
  sequencer_.Emit(ended);
  ASSERT_TRUE(stream->Read(&event));
  EXPECT_EQ(event.sequence(), run.event_sequence() + 3);
  EXPECT_FALSE(event.ended().complete());
  EXPECT_EQ(event.ended().reason(), "the door was opened");
  EXPECT_EQ(event.ended().virtual_s(), 8);
  ASSERT_TRUE(stream->Read(&event));
  EXPECT_EQ(event.lease().change(), "run ended");
  service_->BeginShutdown();
  EXPECT_FALSE(stream->Read(&event));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST_F(ControlServiceTest, AnyoneMayStop) {
  grpc::ClientContext context;
  v1::StopRequest request;
  v1::StopReply reply;
  request.set_reason("smoke");
  ASSERT_TRUE(control_->Stop(&context, request, &reply).ok());
  EXPECT_EQ(sequencer_.stopped(), std::vector<std::string>{"stopped: smoke"});
}

TEST_F(ControlServiceTest, CommandsReachTheSequencer) {
  {
    grpc::ClientContext context;
    v1::PauseRequest request;
    v1::PauseReply reply;
    request.set_reason("lunch");
    EXPECT_TRUE(control_->Pause(&context, request, &reply).ok());
  }
  {
    grpc::ClientContext context;
    v1::PauseRequest request;
    v1::PauseReply reply;
    request.set_now(true);
    EXPECT_TRUE(control_->Pause(&context, request, &reply).ok());
  }
  {
    grpc::ClientContext context;
    v1::ContinueReply reply;
    EXPECT_TRUE(control_->Continue(&context, v1::ContinueRequest(), &reply).ok());
  }
  {
    grpc::ClientContext context;
    v1::AbortReply reply;
    EXPECT_TRUE(control_->Abort(&context, v1::AbortRequest(), &reply).ok());
  }
  {
    grpc::ClientContext context;
    v1::ResetReply reply;
    EXPECT_TRUE(control_->Reset(&context, v1::ResetRequest(), &reply).ok());
  }
  {
    grpc::ClientContext context;
    v1::StartReply reply;
    EXPECT_TRUE(control_->Start(&context, v1::StartRequest(), &reply).ok());
  }
  EXPECT_EQ(
      sequencer_.commands(),
      (std::vector<std::string>{"pause paused: lunch", "pause --now paused by a client",
                                "continue ", "abort aborted by a client", "reset ", "start "}));
}

TEST_F(ControlServiceTest, AFaultIsToldAndNothingStartsAnyMore) {
  service_->ReportFault("mesorig-sim is gone");
  grpc::ClientContext context;
  v1::StatusReply reply;
  ASSERT_TRUE(control_->GetStatus(&context, v1::StatusRequest(), &reply).ok());
  EXPECT_EQ(reply.state(), v1::FAULT);
  EXPECT_EQ(reply.message(), "mesorig-sim is gone");
  v1::RunReply run;
  const grpc::Status status = Run(PlanText(), &run);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(status.error_message(), "mesorig-sim is gone");
  EXPECT_TRUE(ListSessions(root())->empty());
}

// Stops beside Runs: whenever a Stop came, a plan that was being started is not left running
// without the sequencer having heard of the stop.
TEST_F(ControlServiceTest, AStopDuringRunIsNotLost) {
  std::thread stopper([&] {
    for (int i = 0; i < 20; ++i) {
      grpc::ClientContext context;
      v1::StopReply reply;
      EXPECT_TRUE(control_->Stop(&context, v1::StopRequest(), &reply).ok());
    }
  });
  for (int i = 0; i < 5; ++i) {
    v1::RunReply reply;
    const grpc::Status status = Run(PlanText(), &reply);
    EXPECT_TRUE(status.ok() || status.error_code() == grpc::StatusCode::CANCELLED)
        << status.error_message();
    sequencer_.SetStatus({});
    SequencerEvent ended;  // and with it the run's lease
    ended.kind = SequencerEvent::Kind::kEnded;
    sequencer_.Emit(ended);
  }
  stopper.join();
  EXPECT_GE(sequencer_.stopped().size(), 20u);
}

}  // namespace
}  // namespace mesorig::daemon
