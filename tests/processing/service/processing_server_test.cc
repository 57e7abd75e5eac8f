#include "processing/service/processing_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "processing/btf/btf_file.h"
#include "processing/btf/mdf_file.h"
#include "protocol/base/file_writer.h"
#include "protocol/messages/processing.grpc.pb.h"
#include "protocol/plan/plan.h"
#include "tests/processing/assemble/synthetic_session.h"
#include "tests/processing/mesostructure/synthetic_sweep.h"
#include "tests/processing/service/fake_daemon.h"

namespace mesorig::service {
namespace {

using ::testing::HasSubstr;

class ProcessingServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/processd_test_XXXXXX";  // short: a socket's path has 107 bytes
    ASSERT_NE(::mkdtemp(name), nullptr);
    dir_ = name;
    daemon_ = std::make_unique<FakeDaemon>(dir_);
    plan_ = CompilePlan(assemble::PlanText("0, 60", "30, 90", "\"lamp3\"", "\"cam0\", \"cam4\"", 16, 1.0),
                        "test.toml", rig_).value();
  }
  void TearDown() override {
    if (server_ != nullptr) server_->Stop();
    if (runner_.joinable()) runner_.join();
    server_.reset();
    daemon_.reset();
    std::filesystem::remove_all(dir_);
  }
  void StartServer() {
    server_ = ProcessingServer::Start({dir_, dir_ / "products", 10, 5}).value();
    runner_ = std::thread([this] { run_status_ = server_->Run(); });
  }
  v1::SessionReply Session() const {
    v1::SessionReply session;
    session.set_session_id(kId);
    session.set_rig_toml(rig_.source_text);
    session.set_plan_bin(PackPlan(plan_));
    return session;
  }
  // All frames of one shot, as commanded.
  void CommitShot(uint32_t shot, int code = 2000) {
    std::vector<double> axis_rad;
    int lamp = -1;
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kMoveAxes) axis_rad = step.axis_rad;
      if (step.kind == StepKind::kLamp) lamp = step.lamp;
      if (step.kind != StepKind::kShot || step.shot != shot) continue;
      for (const int camera : step.cameras) {
        v1::FrameHeader header;
        header.set_shot(shot);
        header.set_exposure_s(step.exposure_s);
        for (const double a : axis_rad) header.add_axis_rad(a);
        for (int k = 0; k < 8; ++k) header.add_lamp_level(k == lamp ? 1 : 0);
        header.set_width(256), header.set_height(192), header.set_bits(12);
        if (spoil_ && shot == 2 && camera == 4) header.set_digest("0123");
        daemon_->Commit(camera, header, assemble::Uniform(rig_.cameras[0], code));
      }
    }
  }
  // All frames of the plan's sweeps: a slab 2 mm high.
  void CommitSweeps() {
    std::vector<double> axis_rad;
    for (const Step& step : plan_.steps) {
      if (step.kind == StepKind::kMoveAxes) axis_rad = step.axis_rad;
      if (step.kind != StepKind::kSweep) continue;
      mesostructure::SweepScene scene;
      scene.relief = [](double, double) { return 2.0; };
      scene.turntable_deg = DegFromRad(axis_rad[0]), scene.light_arc_deg = DegFromRad(axis_rad[1]);
      for (const int camera : step.cameras) {
        mesostructure::SyntheticSweep sweep(rig_, plan_, step, camera, scene);
        for (uint32_t i = 0; i < sweep.frames(); ++i) {
          CommitSweepFrame(sweep.Frame(i, 1), sweep.Pixels(i));
        }
      }
    }
  }
  void CommitSweepFrame(const mesostructure::SweepFrame& frame, std::string pixels) {
    v1::FrameHeader header;
    header.set_shot(frame.shot);
    header.set_exposure_s(frame.exposure_s);
    for (const double a : frame.axis_rad) header.add_axis_rad(a);
    for (const double level : frame.lamp_level) header.add_lamp_level(level);
    header.set_region_x(static_cast<uint32_t>(frame.region.x));
    header.set_region_y(static_cast<uint32_t>(frame.region.y));
    header.set_width(static_cast<uint32_t>(frame.region.width));
    header.set_height(static_cast<uint32_t>(frame.region.height));
    header.set_bits(12);
    v1::LaserState& laser = *header.mutable_laser();
    laser.set_sweep(frame.sweep), laser.set_index(frame.index);
    laser.set_mount(static_cast<uint32_t>(frame.mount));
    laser.set_tilt_rad(frame.tilt_rad), laser.set_on(frame.on);
    daemon_->Commit(frame.camera, header, std::move(pixels));
  }
  v1::ProductsReply Await() {
    auto channel = wire::ConnectTo(dir_, wire::kProcessingName, 10).value();
    auto stub = v1::Processing::NewStub(channel);
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    v1::ProductsRequest request;
    request.set_session_id(kId);
    v1::ProductsReply reply;
    await_status_ = stub->AwaitProducts(&context, request, &reply);
    return reply;
  }
  size_t FilesInProducts() const {
    size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(dir_ / "products")) {
      (void)entry;
      ++files;
    }
    return files;
  }

  static constexpr const char* kId = "20260101-demo";
  std::filesystem::path dir_;
  Rig rig_ = assemble::DemoRig();
  CompiledPlan plan_;
  bool spoil_ = false;
  std::unique_ptr<FakeDaemon> daemon_;
  std::unique_ptr<ProcessingServer> server_;
  std::thread runner_;
  Status run_status_;
  grpc::Status await_status_;
};

TEST_F(ProcessingServerTest, MakesTheProductOfASession) {
  daemon_->Listen();
  StartServer();
  daemon_->SetSession(Session());  // told by an event
  for (uint32_t shot = 0; shot < plan_.shots; ++shot) CommitShot(shot);
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  ASSERT_TRUE(await_status_.ok()) << await_status_.error_message();
  EXPECT_EQ(reply.error(), "");
  EXPECT_TRUE(reply.done());
  EXPECT_EQ(reply.frames_received(), 8u);
  EXPECT_EQ(reply.frames_expected(), 8u);
  EXPECT_GT(reply.processing_s(), 0);
  EXPECT_GT(reply.wall_s(), 0);
  ASSERT_EQ(reply.products_size(), 1);
  EXPECT_EQ(reply.products(0).kind(), "btf");
  EXPECT_EQ(reply.products(0).path(), (dir_ / "products" / kId / "sample.btf.exr").string());
  const auto btf = btf::ReadSampledBtf(reply.products(0).path());
  ASSERT_TRUE(btf.ok()) << btf.status();
  EXPECT_EQ(btf->present_count(), 7u);
  EXPECT_THAT(btf->header().provenance_json, HasSubstr(kId));
  EXPECT_EQ(FilesInProducts(), 2u) << "folder and product, no work file";
}

TEST_F(ProcessingServerTest, SweepsBecomeAnMdfAndTheirFramesMayGo) {
  plan_ = CompilePlan(mesostructure::SweepPlanText("0", "90, 270", "\"cam0\", \"cam2\"", 32),
                      "test.toml", rig_).value();
  daemon_->RefuseReleases(1);  // told again
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  CommitSweeps();
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  EXPECT_EQ(reply.error(), "");
  ASSERT_EQ(reply.products_size(), 1);
  EXPECT_EQ(reply.products(0).kind(), "mdf");
  EXPECT_EQ(reply.frames_received(), 128u);
  EXPECT_EQ(reply.frames_expected(), 128u);
  const auto mdf = btf::ReadMdf(reply.products(0).path());
  ASSERT_TRUE(mdf.ok()) << mdf.status();
  EXPECT_EQ(mdf->header().view_count(), 2);
  EXPECT_NEAR(mdf->Distance(0)[32 * 64 + 32], 2.2, 0.1);
  EXPECT_EQ(daemon_->released(), (std::set<uint32_t>{0, 1}));
}

TEST_F(ProcessingServerTest, LampsAndSweepsGiveBothProductsAlsoAfterARestartWithoutTheFrames) {
  std::string text = mesostructure::SweepPlanText("0", "90", "\"cam2\"", 32);
  text += "[[grid]]\nexposure_s = 0.02\nlamps = [\"lamp3\"]\ncameras = [\"cam2\"]\n"
          "[grid.axes.turntable]\nangles_deg = [0]\n[grid.axes.light_arc]\nangles_deg = [90]\n";
  plan_ = CompilePlan(text, "test.toml", rig_).value();
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  CommitSweeps();
  while (daemon_->released().empty()) std::this_thread::yield();
  // Killed after the sweep's frames are gone, before the end: the next one needs them no more.
  server_->Stop();
  runner_.join();
  server_.reset();
  StartServer();
  for (uint32_t shot = 0; shot < plan_.shots; ++shot) CommitShot(shot);
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  EXPECT_EQ(reply.error(), "");
  ASSERT_EQ(reply.products_size(), 2);
  EXPECT_EQ(reply.products(0).kind(), "btf");
  EXPECT_EQ(reply.products(1).kind(), "mdf");
  EXPECT_EQ(reply.frames_received(), 33u);
  const auto btf = btf::ReadBtfInfo(reply.products(0).path());
  const auto mdf = btf::ReadMdfInfo(reply.products(1).path());
  ASSERT_TRUE(btf.ok() && mdf.ok());
  EXPECT_LT(AngleBetween(btf->header.views[0], mdf->header.views[0]), 1e-6);
}

TEST_F(ProcessingServerTest, CalibrationFramesAloneHaveNoProduct) {
  plan_ = CompilePlan("name = \"dark\"\n[sample]\nname = \"s\"\n[product]\nwidth_px = 8\nheight_px = "
                      "8\npitch_mm = 1\nh_ref_mm = 4\n[[calibration]]\nkind = \"dark\"\n"
                      "exposures_s = [0.02]\ncameras = [\"cam0\"]\nrepeats = 2\n",
                      "test.toml", rig_).value();
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  for (uint32_t shot = 0; shot < plan_.shots; ++shot) CommitShot(shot, 70);
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  EXPECT_EQ(reply.error(), "");
  EXPECT_TRUE(reply.done());
  EXPECT_EQ(reply.products_size(), 0);
  EXPECT_EQ(reply.frames_received(), 2u);
}

// The second dark frame comes after all others: these are read once more, and the value is that of
// the mean of both, (2000 - 80) codes of 4031.
TEST_F(ProcessingServerTest, FramesAreReadOnceMoreForALateDarkOne) {
  plan_ = CompilePlan(assemble::PlanText("0", "90", "\"lamp3\"", "\"cam0\"", 16, 1.0) +
                          "[[calibration]]\nkind = \"ambient\"\nrepeats = 2\n",
                      "test.toml", rig_).value();
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  CommitShot(0, 70), CommitShot(2, 2000), CommitShot(1, 90);
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  ASSERT_EQ(reply.error(), "");
  ASSERT_EQ(reply.products_size(), 1);
  const auto late = btf::ReadSampledBtf(reply.products(0).path());
  ASSERT_TRUE(late.ok()) << late.status();
  const Vec3 d = late->header().light_positions_mm[0] - late->header().TexelCentre(3, 7);
  EXPECT_NEAR(late->Image(0, 0)[3 * (7 * 16 + 3) + 1], 1920.0 / 4031 * 25 / (20 / (1e-6 * Dot(d, d))),
              1e-6);
}

TEST_F(ProcessingServerTest, GoesOnFromItsCursorWhenStreamsBreakAndTheDaemonRestarts) {
  daemon_->BreakEvery(1);
  daemon_->announced_running = true;
  daemon_->SetSession(Session());
  daemon_->Listen();
  CommitShot(0), CommitShot(1);
  StartServer();  // takes up the running one
  CommitShot(2);
  daemon_->Shutdown();
  CommitShot(3);
  daemon_->End(true);
  daemon_->Listen();
  const v1::ProductsReply reply = Await();
  ASSERT_TRUE(reply.done()) << reply.error() << await_status_.error_message();
  EXPECT_EQ(reply.frames_received(), 8u) << "no frame twice";
  EXPECT_GE(daemon_->subscriptions(), 6);
}

TEST_F(ProcessingServerTest, SaysThatASessionIsIncompleteAndWritesNothing) {
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  CommitShot(0), CommitShot(1);
  daemon_->End(false);
  const v1::ProductsReply reply = Await();
  EXPECT_FALSE(reply.done());
  EXPECT_THAT(reply.error(), HasSubstr("the session ended incomplete"));
  EXPECT_EQ(reply.products_size(), 0);
  EXPECT_EQ(FilesInProducts(), 0u);
}

TEST_F(ProcessingServerTest, AMissingFrameIsAnErrorThoughTheLedgerSaysComplete) {
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  for (uint32_t shot = 0; shot + 1 < plan_.shots; ++shot) CommitShot(shot);
  daemon_->End(true);
  EXPECT_THAT(Await().error(), HasSubstr("6 of 8 planned frames arrived"));
  EXPECT_EQ(FilesInProducts(), 0u);
}

TEST_F(ProcessingServerTest, NamesTheFrameWhoseDigestIsWrong) {
  spoil_ = true;
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  for (uint32_t shot = 0; shot < plan_.shots; ++shot) CommitShot(shot);
  daemon_->End(true);
  const v1::ProductsReply reply = Await();
  EXPECT_THAT(reply.error(), HasSubstr("cam4, shot 2, sequence 3: its 98304 bytes have the digest"));
  EXPECT_THAT(reply.error(), HasSubstr("the ledger says 0123"));
  EXPECT_EQ(FilesInProducts(), 0u);
}

TEST_F(ProcessingServerTest, UnknownSessionsAndIdsThatArePaths) {
  daemon_->Listen();
  daemon_->SetSession(Session());
  StartServer();
  auto stub = v1::Processing::NewStub(wire::ConnectTo(dir_, wire::kProcessingName, 10).value());
  for (const char* id : {"", "..", "../../etc", "a/b", ".hidden"}) {
    grpc::ClientContext context;
    v1::ProductsRequest request;
    request.set_session_id(id);
    v1::ProductsReply reply;
    EXPECT_EQ(stub->AwaitProducts(&context, request, &reply).error_code(),
              grpc::StatusCode::INVALID_ARGUMENT) << id;
  }
  v1::ProductsRequest request;
  request.set_session_id("other");
  v1::ProductsReply reply;
  grpc::ClientContext get, await;
  EXPECT_EQ(stub->GetProducts(&get, request, &reply).error_code(), grpc::StatusCode::NOT_FOUND);
  ASSERT_TRUE(stub->AwaitProducts(&await, request, &reply).ok());
  EXPECT_THAT(reply.error(), HasSubstr("no session other"));
}

TEST_F(ProcessingServerTest, AMalformedPlanOrRigIsAnErrorOfTheSession) {
  daemon_->Listen();
  v1::SessionReply session = Session();
  session.set_plan_bin("nonsense");
  daemon_->SetSession(session);
  StartServer();
  EXPECT_NE(Await().error(), "");
  EXPECT_EQ(FilesInProducts(), 0u);
}

TEST_F(ProcessingServerTest, RefusesAnotherProtocol) {
  daemon_->protocol_major = wire::kProtocolMajor + 1;
  daemon_->Listen();
  auto server = ProcessingServer::Start({dir_, dir_ / "products", 10, 5}).value();
  const Status status = server->Run();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
}

TEST_F(ProcessingServerTest, WaitsForTheDaemonOnlySoLong) {
  auto server = ProcessingServer::Start({dir_, dir_ / "products", 0.05, 5}).value();
  const Status status = server->Run();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("mesorigd is not running"));
}

TEST_F(ProcessingServerTest, TheProgramEndsCleanlyOnSigterm) {
  daemon_->Listen();
  daemon_->SetSession(Session());
  CommitShot(0);
  const std::string program = std::string(MESORIG_BIN_DIR) + "/mesorig-processd";
  const std::string products = (dir_ / "products").string(), runtime = dir_.string();
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl(program.c_str(), program.c_str(), "--runtime-dir", runtime.c_str(), "--products",
            products.c_str(), nullptr);
    ::_exit(127);
  }
  while (daemon_->subscriptions() < 2) std::this_thread::yield();
  auto stub = v1::Processing::NewStub(wire::ConnectTo(dir_, wire::kProcessingName, 10).value());
  std::thread waiter([&] {  // the call ends with the program
    grpc::ClientContext context;
    v1::ProductsRequest request;
    request.set_session_id(kId);
    v1::ProductsReply reply;
    await_status_ = stub->AwaitProducts(&context, request, &reply);
  });
  ::kill(child, SIGTERM);
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  waiter.join();
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  EXPECT_FALSE(await_status_.ok());
  EXPECT_EQ(FilesInProducts(), 0u);
}

}  // namespace
}  // namespace mesorig::service
