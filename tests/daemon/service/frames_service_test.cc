#include "protocol/base/digest.h"
#include "tests/daemon/service/service_fixture.h"

namespace mesorig::daemon {
namespace {

class FramesServiceTest : public ServiceTest {
 protected:
  // Starts the small plan and returns its session.
  std::shared_ptr<Session> StartSession() {
    v1::RunReply reply;
    const grpc::Status status = Run(PlanText(), &reply);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return sequencer_.session();
  }
  // What an ordinary generated client reads until the stream ends.
  grpc::Status Subscribe(const std::string& id, uint32_t camera, uint64_t cursor,
                         std::vector<v1::Frame>* frames) {
    grpc::ClientContext context;
    v1::SubscribeRequest request;
    request.set_session_id(id);
    request.set_camera(camera);
    request.set_cursor(cursor);
    const auto stream = frames_->Subscribe(&context, request);
    v1::Frame frame;
    while (stream->Read(&frame)) frames->push_back(frame);
    return stream->Finish();
  }
};

TEST_F(FramesServiceTest, SubscribersFollowALiveSession) {
  const auto session = StartSession();
  std::vector<std::vector<v1::Frame>> got(16);
  std::vector<std::thread> clients;
  std::atomic<int> ok{0};
  for (size_t i = 0; i < got.size(); ++i) {
    clients.emplace_back([&, i] {
      if (Subscribe(session->id(), static_cast<uint32_t>(i % 8), 0, &got[i]).ok()) ++ok;
    });
  }
  ASSERT_TRUE(AppendAll(*session, sequencer_.plan()).ok());
  ASSERT_TRUE(session->Finish(true, "", 1, 1, true).ok());
  for (auto& client : clients) client.join();
  EXPECT_EQ(ok, 16);
  for (size_t i = 0; i < got.size(); ++i) {
    ASSERT_EQ(got[i].size(), 8u);
    for (uint32_t k = 0; k < 8; ++k) {
      const v1::FrameHeader& header = got[i][k].header();
      EXPECT_EQ(header.sequence(), k + 1);
      EXPECT_EQ(header.camera(), i % 8);
      EXPECT_EQ(header.shot(), k);
      EXPECT_EQ(header.axis_rad(0), 0.25 * k);
      EXPECT_EQ(header.lamp_level_size(), 8);
      EXPECT_EQ(header.digest(), FrameDigest(got[i][k].pixels()));
      EXPECT_EQ(got[i][k].pixels(), *PixelsOf(static_cast<int>(i % 8), k));
    }
  }
}

TEST_F(FramesServiceTest, ACursorGoesOnWhereItWas) {
  const auto session = StartSession();
  ASSERT_TRUE(AppendAll(*session, sequencer_.plan()).ok());
  ASSERT_TRUE(session->Finish(true, "", 1, 1, true).ok());
  std::vector<v1::Frame> frames;
  ASSERT_TRUE(Subscribe(session->id(), 2, 5, &frames).ok());
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_EQ(frames[0].header().sequence(), 6u);
  frames.clear();
  ASSERT_TRUE(Subscribe(session->id(), 2, 8, &frames).ok());
  EXPECT_TRUE(frames.empty());
}

TEST_F(FramesServiceTest, AnIncompleteEndAborts) {
  const auto session = StartSession();
  ASSERT_TRUE(session->Append(FrameOf(0, 0), PixelsOf(0, 0)).ok());
  ASSERT_TRUE(session->Finish(false, "stopped: smoke", 1, 1, true).ok());
  std::vector<v1::Frame> frames;
  const grpc::Status status = Subscribe(session->id(), 0, 0, &frames);
  EXPECT_EQ(frames.size(), 1u);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED);
  EXPECT_NE(status.error_message().find("stopped: smoke"), std::string::npos);
}

// Written by a daemon that was killed: what was committed, then ABORTED, not an endless wait.
TEST_F(FramesServiceTest, AKilledSessionEnds) {
  std::string id;
  {
    auto session = Session::Create(root(), SmallPlan(rig_), rig_);
    ASSERT_TRUE(session.ok());
    id = (*session)->id();
    ASSERT_TRUE((*session)->Append(FrameOf(3, 0), PixelsOf(3, 0)).ok());
  }
  std::vector<v1::Frame> frames;
  const grpc::Status status = Subscribe(id, 3, 0, &frames);
  EXPECT_EQ(frames.size(), 1u);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::ABORTED);
  grpc::ClientContext context;
  v1::SessionRequest request;
  v1::SessionReply reply;
  request.set_session_id(id);
  ASSERT_TRUE(frames_->GetSession(&context, request, &reply).ok());
  EXPECT_TRUE(reply.ended());
  EXPECT_FALSE(reply.complete());
}

TEST_F(FramesServiceTest, SessionsAreDescribedAndListed) {
  const auto session = StartSession();
  grpc::ClientContext list_context, context, unknown_context;
  v1::ListSessionsReply list;
  ASSERT_TRUE(frames_->ListSessions(&list_context, v1::ListSessionsRequest(), &list).ok());
  ASSERT_EQ(list.session_ids_size(), 1);
  EXPECT_EQ(list.session_ids(0), session->id());
  v1::SessionRequest request;
  v1::SessionReply reply;
  request.set_session_id(session->id());
  ASSERT_TRUE(frames_->GetSession(&context, request, &reply).ok());
  EXPECT_EQ(reply.rig_toml(), rig_.source_text);
  EXPECT_EQ(Sha256(reply.plan_bin()), reply.plan_sha256());
  EXPECT_TRUE(UnpackPlan(reply.plan_bin(), rig_).ok());
  EXPECT_FALSE(reply.ended());
  request.set_session_id("../" + session->id());
  EXPECT_EQ(frames_->GetSession(&unknown_context, request, &reply).error_code(),
            grpc::StatusCode::NOT_FOUND);
}

TEST_F(FramesServiceTest, WrongRequestsAreRefused) {
  const auto session = StartSession();
  std::vector<v1::Frame> frames;
  EXPECT_EQ(Subscribe("nothing", 0, 0, &frames).error_code(), grpc::StatusCode::NOT_FOUND);
  for (const uint32_t camera : {8u, 0x80000000u, 0xFFFFFFFFu}) {
    EXPECT_EQ(Subscribe(session->id(), camera, 0, &frames).error_code(),
              grpc::StatusCode::INVALID_ARGUMENT);
  }
}

TEST_F(FramesServiceTest, ASweepIsReleasedAndItsFramesArePassedOver) {
  const CompiledPlan plan = SweepingPlan(rig_);
  const auto release = [&](const std::string& id, uint32_t sweep, v1::ReleaseSweepReply* reply) {
    grpc::ClientContext context;
    v1::ReleaseSweepRequest request;
    request.set_session_id(id);
    request.set_sweep(sweep);
    return frames_->ReleaseSweep(&context, request, reply);
  };
  std::string id;
  {
    auto session = Session::Create(root(), plan, rig_);
    ASSERT_TRUE(session.ok());
    id = (*session)->id();
    ASSERT_TRUE(AppendAll(**session, plan).ok());
    ASSERT_TRUE((*session)->Finish(true, "", 1, 1, true).ok());
  }
  std::vector<v1::Frame> before, after;
  ASSERT_TRUE(Subscribe(id, 3, 0, &before).ok());
  ASSERT_EQ(before.size(), 20u);
  EXPECT_FALSE(before[7].header().has_laser());
  EXPECT_EQ(before[7].header().region_x(), 0u);
  const v1::FrameHeader& swept = before[12].header();  // the second frame of sweep 1
  EXPECT_EQ(swept.region_x(), 2u);
  EXPECT_EQ(swept.region_y(), 4u);
  EXPECT_EQ(swept.width(), 6u);
  EXPECT_EQ(swept.laser().sweep(), 1u);
  EXPECT_EQ(swept.laser().index(), 1u);
  EXPECT_EQ(swept.laser().mount(), 1u);
  EXPECT_EQ(swept.laser().tilt_rad(), 0.01 - 0.001);
  EXPECT_FALSE(swept.laser().on());
  EXPECT_TRUE(before[13].header().laser().on());

  v1::ReleaseSweepReply reply;
  EXPECT_EQ(release("nothing", 1, &reply).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(release(id, 3, &reply).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(release(id, 0, &reply).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  const grpc::Status released = release(id, 1, &reply);
  ASSERT_TRUE(released.ok()) << released.error_message();
  EXPECT_GT(reply.bytes_freed(), 15u * 48);
  ASSERT_TRUE(release(id, 1, &reply).ok()) << "again";
  EXPECT_EQ(reply.bytes_freed(), 0u);
  ASSERT_TRUE(release(id, 2, &reply).ok());
  const grpc::Status status = Subscribe(id, 3, 0, &after);
  EXPECT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(after.size(), 11u);
  for (size_t i = 0; i < after.size(); ++i) {
    EXPECT_EQ(after[i].SerializeAsString(), before[i].SerializeAsString());
  }
}

// A subscriber that leaves, and one that is there when the daemon ends: both are let go at once.
TEST_F(FramesServiceTest, StreamsEndWithTheirClientAndWithTheDaemon) {
  const auto session = StartSession();
  v1::SubscribeRequest request;
  request.set_session_id(session->id());
  {
    grpc::ClientContext leaving;
    const auto stream = frames_->Subscribe(&leaving, request);
    leaving.TryCancel();
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  grpc::ClientContext context;
  const auto stream = frames_->Subscribe(&context, request);
  service_->BeginShutdown();
  v1::Frame frame;
  EXPECT_FALSE(stream->Read(&frame));
  EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
}

// 300 frames of the demo's size through an ordinary client, for the record.
TEST_F(FramesServiceTest, Throughput) {
  auto session = Session::Create(root(), SmallPlan(rig_), rig_);
  ASSERT_TRUE(session.ok());
  constexpr uint32_t kFrames = 300;
  constexpr size_t kBytes = 256 * 192 * 2;
  for (uint32_t shot = 0; shot < kFrames; ++shot) {
    FrameRecord record = FrameOf(1, shot);
    record.width = 256;
    record.height = 192;
    ASSERT_TRUE((*session)->Append(record, PixelsOf(1, shot, kBytes)).ok());
  }
  ASSERT_TRUE((*session)->Finish(false, "", 1, 1, true).ok());
  std::vector<v1::Frame> frames;
  const auto began = std::chrono::steady_clock::now();
  Subscribe((*session)->id(), 1, 0, &frames);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - began;
  ASSERT_EQ(frames.size(), kFrames);
  EXPECT_EQ(frames.back().pixels(), *PixelsOf(1, kFrames - 1, kBytes));
  fmt::print("{:.0f} MB/s from the ledger through one subscription\n",
             kFrames * kBytes / took.count() / 1e6);
}

}  // namespace
}  // namespace mesorig::daemon
