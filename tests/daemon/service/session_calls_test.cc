// Calls on whole sessions, previews, and consumers of a session that is resumed.

#include "daemon/service/preview.h"
#include "daemon/service/session_store.h"
#include "tests/daemon/service/service_fixture.h"

namespace mesorig::daemon {
namespace {

class SessionCalls : public ServiceTest {
 protected:
  std::string CreateEnded(bool complete) {
    auto session = Session::Create(root(), plan_, rig_);
    EXPECT_TRUE(session.ok()) << session.status();
    EXPECT_TRUE((*session)->Record({JournalKind::kBegan, 5'000'000, -1, 0, "here we go"}).ok());
    EXPECT_TRUE(AppendAll(**session, plan_).ok());
    EXPECT_TRUE((*session)->Finish(complete, "stopped", 1, 1, true).ok());
    return (*session)->id();
  }
  grpc::Status Verify(const std::string& id, v1::VerifyReport* report) {
    grpc::ClientContext context;
    v1::SessionRequest request;
    request.set_session_id(id);
    const auto stream = frames_->Verify(&context, request);
    v1::VerifyReply reply;
    uint32_t done = 0;
    while (stream->Read(&reply)) {
      EXPECT_GE(reply.frames_done(), done);
      done = reply.frames_done();
      if (reply.has_report()) *report = reply.report();
    }
    return stream->Finish();
  }
  const CompiledPlan plan_ = SweepingPlan(rig_);
};

TEST_F(SessionCalls, VerifyBalancesOrTellsWhatDoesNot) {
  const std::string id = CreateEnded(true);
  v1::VerifyReport report;
  ASSERT_TRUE(Verify(id, &report).ok());
  EXPECT_TRUE(report.balances());
  EXPECT_EQ(report.frames_live(), plan_.frames);
  EXPECT_EQ(report.session().state(), "complete");
  EXPECT_EQ(report.entries(0).kind(), "began");
  EXPECT_EQ(report.entries(0).rig_s(), 0.005);
  EXPECT_EQ(report.content_digest().size(), 32u);
  std::filesystem::remove(root() / id / "cam3.seg");
  ASSERT_TRUE(Verify(id, &report).ok());
  EXPECT_FALSE(report.balances());
  ASSERT_EQ(report.imbalances_size(), 1);
  EXPECT_EQ(report.imbalances(0).count(), 8u + 3);
  EXPECT_NE(report.imbalances(0).first().find("cam3.seg"), std::string::npos);
  EXPECT_EQ(Verify("nothing", &report).error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(SessionCalls, SessionsAreListedRemovedAndCleaned) {
  const std::string complete = CreateEnded(true), incomplete = CreateEnded(false);
  v1::ListSessionsReply list;
  {
    grpc::ClientContext context;
    ASSERT_TRUE(frames_->ListSessions(&context, v1::ListSessionsRequest(), &list).ok());
  }
  ASSERT_EQ(list.sessions_size(), 2);
  EXPECT_EQ(list.sessions(0).state(), "complete");
  EXPECT_EQ(list.sessions(1).state(), "incomplete");
  EXPECT_EQ(list.sessions(1).reason(), "stopped");
  EXPECT_GT(list.disk_free_bytes(), 0u);
  const auto remove = [&](const std::string& id, bool complete_too) {
    grpc::ClientContext context;
    v1::RemoveSessionRequest request;
    v1::RemoveSessionReply reply;
    request.set_session_id(id);
    request.set_complete_too(complete_too);
    return frames_->RemoveSession(&context, request, &reply).error_code();
  };
  EXPECT_EQ(remove(complete, false), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(remove("../x", true), grpc::StatusCode::NOT_FOUND);
  const auto clean = [&](bool incomplete_too, v1::CleanSessionsReply* reply) {
    grpc::ClientContext context;
    v1::CleanSessionsRequest request;
    request.set_keep(0);
    request.set_incomplete_too(incomplete_too);
    return frames_->CleanSessions(&context, request, reply);
  };
  v1::CleanSessionsReply cleaned;
  ASSERT_TRUE(clean(false, &cleaned).ok());
  ASSERT_EQ(cleaned.session_ids_size(), 1);
  EXPECT_EQ(cleaned.session_ids(0), complete);
  EXPECT_GT(cleaned.bytes_freed(), 0u);
  EXPECT_EQ(remove(incomplete, false), grpc::StatusCode::OK);
  EXPECT_TRUE(ListSessions(root())->empty());
  grpc::ClientContext context;
  EXPECT_EQ(frames_->CleanSessions(&context, v1::CleanSessionsRequest(), &cleaned).error_code(),
            grpc::StatusCode::INVALID_ARGUMENT)
      << "no rule";
}

// The newest frame, and how many went by; a client that takes none holds nobody up.
TEST_F(SessionCalls, PreviewsAreDroppedAndCounted) {
  v1::RunReply reply;
  ASSERT_TRUE(Run(PlanText(), &reply).ok());
  const auto session = sequencer_.session();
  grpc::ClientContext context, idle_context;
  v1::PreviewRequest request;
  request.set_camera(2);
  const auto idle = frames_->Preview(&idle_context, request);  // never reads
  for (uint32_t shot = 0; shot < 3; ++shot) {
    ASSERT_TRUE(session->Append(FrameOf(2, shot), PixelsOf(2, shot)).ok());
  }
  const auto stream = frames_->Preview(&context, request);
  v1::PreviewFrame frame;
  ASSERT_TRUE(stream->Read(&frame));
  EXPECT_EQ(frame.session_id(), session->id());
  EXPECT_EQ(frame.shot(), 2u);
  EXPECT_EQ(frame.dropped(), 2u);
  EXPECT_EQ(frame.width(), 4u);
  EXPECT_EQ(frame.grey().size(), 16u);
  ASSERT_TRUE(session->Append(FrameOf(2, 3), PixelsOf(2, 3)).ok());
  ASSERT_TRUE(stream->Read(&frame));
  EXPECT_EQ(frame.shot(), 3u);
  EXPECT_EQ(frame.dropped(), 0u);
  context.TryCancel();
  idle_context.TryCancel();
  EXPECT_FALSE(stream->Finish().ok());
}

TEST(Preview, IsSmallAndKeepsTheMean) {
  FrameRecord record;
  record.width = 1024;
  record.height = 768;
  record.bits = 12;
  std::string pixels(1024 * 768 * 2, '\0');
  for (size_t i = 0; i < pixels.size(); i += 2) pixels[i + 1] = 8;  // 2048 of 4095
  const PreviewImage image = MakePreview(record, pixels);
  EXPECT_EQ(image.width, 128);
  EXPECT_EQ(image.height, 96);
  EXPECT_EQ(image.grey, std::string(128 * 96, '\x80'));
  record.bits = 8;
  record.width = 320;
  record.height = 3;
  const PreviewImage low = MakePreview(record, std::string(960, '\x40'));
  EXPECT_EQ(low.width, 160);
  EXPECT_EQ(low.height, 1);
  EXPECT_EQ(low.grey, std::string(160, '\x40'));
  EXPECT_EQ(MakePreview(record, std::string(959, 'x')).grey, "") << "too short";
  record.height = 1;
  EXPECT_EQ(MakePreview(record, std::string(960, 'x')).grey, "");
}

// A consumer that was reading a killed session goes on in the resumed one: every row once, in
// order.
TEST_F(SessionCalls, AResumedSessionIsLiveForItsReaders) {
  std::string id;
  {
    auto session = Session::Create(root(), plan_, rig_);
    ASSERT_TRUE(session.ok());
    id = (*session)->id();
    for (uint32_t shot = 0; shot < 3; ++shot) {
      ASSERT_TRUE((*session)->Append(FrameOf(5, shot), PixelsOf(5, shot)).ok());
    }
  }
  std::filesystem::create_directories(root() / ".half-made.part");
  SessionStore store(root());
  EXPECT_FALSE(std::filesystem::exists(root() / ".half-made.part"));
  const auto before = store.Find(id);
  ASSERT_TRUE(before.ok());
  EXPECT_FALSE(store.IsLive(**before));
  const auto resumed = store.Resume(id, rig_);
  ASSERT_TRUE(resumed.ok()) << resumed.status();
  EXPECT_TRUE(store.IsLive(**resumed));
  EXPECT_EQ(*store.Find(id), *resumed);
  EXPECT_FALSE(store.IsLive(**before));
  EXPECT_TRUE(absl::IsFailedPrecondition(store.Resume(id, rig_).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(store.Remove(id).status()));
  ASSERT_TRUE((*resumed)->Append(FrameOf(5, 3), PixelsOf(5, 3)).ok());
  ASSERT_TRUE((*resumed)->Flush().ok());
  EXPECT_EQ((*(*resumed)->Next(5, 3, 0))->record.shot, 3u);
  EXPECT_EQ((*(*before)->Next(5, 2, 0))->record.shot, 2u) << "what it knew it still has";
}

// The writer runs at full speed while one subscriber never reads and one reads slowly.
TEST_F(SessionCalls, NobodySlowsTheCapture) {
  v1::RunReply reply;
  ASSERT_TRUE(Run(PlanText(), &reply).ok());
  const auto session = sequencer_.session();
  v1::SubscribeRequest request;
  request.set_session_id(session->id());
  request.set_camera(1);
  grpc::ClientContext never_context, slow_context;
  const auto never = frames_->Subscribe(&never_context, request);
  const auto slow = frames_->Subscribe(&slow_context, request);
  constexpr uint32_t kFrames = 400;
  constexpr size_t kBytes = 256 * 192 * 2;
  const auto pixels = PixelsOf(1, 0, kBytes);
  for (uint32_t i = 0; i < kFrames; ++i) {
    FrameRecord record = FrameOf(1, i);
    record.width = 256;
    record.height = 192;
    ASSERT_TRUE(session->Append(record, pixels).ok());
    v1::Frame frame;
    if (i % 50 == 0) {
      ASSERT_TRUE(slow->Read(&frame));
      EXPECT_EQ(frame.header().sequence(), i / 50 + 1);
    }
  }
  ASSERT_TRUE(session->Flush().ok()) << "all is durable, and hardly anything was read";
  EXPECT_EQ(session->Summary().frames_durable, kFrames);
  ASSERT_TRUE(session->Finish(false, "enough", 1, 1, true).ok());
  never_context.TryCancel();
  v1::Frame frame;
  uint64_t last = kFrames / 50;
  while (slow->Read(&frame)) EXPECT_EQ(frame.header().sequence(), ++last);
  EXPECT_EQ(last, kFrames);
  EXPECT_EQ(slow->Finish().error_code(), grpc::StatusCode::ABORTED);
  EXPECT_FALSE(never->Finish().ok());
}

}  // namespace
}  // namespace mesorig::daemon
