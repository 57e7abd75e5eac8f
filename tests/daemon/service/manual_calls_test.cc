// Leases, the rig by hand and the audit log over the wire, on a rig in memory.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "daemon/service/audit_interceptor.h"
#include "daemon/service/call_table.h"
#include "protocol/base/digest.h"
#include "tests/daemon/service/any_call.h"
#include "tests/daemon/service/by_hand_fixture.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

class ManualCallsTest : public ByHandTest {
 protected:
  grpc::Status Lamp(uint64_t token, const std::string& lamp) {
    grpc::ClientContext context;
    v1::SetLampRequest request;
    request.set_lease_token(token);
    request.set_lamp(lamp);
    v1::ManualReply reply;
    return control_->SetLamp(&context, request, &reply);
  }
  v1::StatusReply GetStatus() {
    grpc::ClientContext context;
    v1::StatusReply reply;
    EXPECT_TRUE(control_->GetStatus(&context, v1::StatusRequest(), &reply).ok());
    return reply;
  }
  std::string AuditBytes(uint64_t offset = 0) {
    grpc::ClientContext context;
    v1::ReadAuditRequest request;
    request.set_offset(offset);
    const auto stream = control_->ReadAudit(&context, request);
    v1::AuditBytes bytes;
    std::string all;
    while (stream->Read(&bytes)) all += bytes.data();
    EXPECT_TRUE(stream->Finish().ok());
    return all;
  }
  std::vector<nlohmann::json> Entries(const std::string& call) {
    std::vector<nlohmann::json> entries;
    std::istringstream in(AuditBytes());
    for (std::string line; std::getline(in, line);) {
      auto entry = nlohmann::json::parse(line);
      if (entry["call"] == call) entries.push_back(std::move(entry));
    }
    return entries;
  }
};

TEST_F(ManualCallsTest, OnlyTheHolderCommands) {
  const std::string lamp = rig_.lamps[1].name;
  EXPECT_EQ(Lamp(0, lamp).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  const v1::LeaseStatus lease = Take();
  EXPECT_EQ(lease.kind(), v1::LEASE_MANUAL);
  EXPECT_NEAR(lease.left_s(), 10, 1);
  EXPECT_TRUE(Lamp(lease.token(), lamp).ok());
  EXPECT_EQ(Lamp(lease.token() + 1, lamp).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(Lamp(lease.token(), "no such").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(hand_.said(), std::vector<std::string>{"lamp 1"});
  const v1::LeaseStatus newer = Take(true);
  EXPECT_GT(newer.token(), lease.token());
  EXPECT_THAT(Lamp(lease.token(), lamp).error_message(), HasSubstr("is over"));
  // Whoever asks for the status is not told the token.
  EXPECT_EQ(GetStatus().lease().token(), 0u);
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_MANUAL);
}

TEST_F(ManualCallsTest, ReadingsSayWhereTheyAreFrom) {
  const v1::StatusReply status = GetStatus();
  ASSERT_EQ(status.readings_size(), 1);
  EXPECT_EQ(status.readings(0).source(), v1::COMMANDED);
}

TEST_F(ManualCallsTest, APlanEndsTheLeaseAndHoldsItsOwn) {
  const v1::LeaseStatus lease = Take();
  v1::RunReply reply;
  EXPECT_EQ(Run(PlanText(), &reply).error_code(), grpc::StatusCode::FAILED_PRECONDITION)
      << "without the token";
  EXPECT_TRUE(hand_.open());
  grpc::ClientContext context;
  v1::RunRequest request;
  request.set_plan_toml(PlanText());
  request.set_lease_token(lease.token());
  const grpc::Status run = control_->Run(&context, request, &reply);
  ASSERT_TRUE(run.ok()) << run.error_message();
  EXPECT_FALSE(hand_.open());
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_RUN);
  EXPECT_FALSE(Lamp(lease.token(), "").ok());
  grpc::ClientContext again;
  v1::LeaseReply refused;
  EXPECT_THAT(control_->AcquireLease(&again, v1::AcquireLeaseRequest(), &refused).error_message(),
              HasSubstr("a plan that"));
  SequencerEvent end;
  end.kind = SequencerEvent::Kind::kEnded;
  end.complete = true;
  sequencer_.Emit(end);
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_FREE);
  EXPECT_GT(Take().token(), lease.token() + 1);
}

TEST_F(ManualCallsTest, APlanThatDoesNotBeginLeavesNoLease) {
  v1::RunReply reply;
  sequencer_.Refuse(FailedPrecondition("the chain is open"));
  EXPECT_FALSE(Run(PlanText(), &reply).ok());
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_FREE);
  sequencer_.Refuse(OkStatus());
  hand_.SetRest(Unavailable("not at rest"));
  EXPECT_THAT(Run(PlanText(), &reply).error_message(), HasSubstr("not at rest"));
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_FREE);
  hand_.SetRest(OkStatus());
  EXPECT_TRUE(Run(PlanText(), &reply).ok());
}

TEST_F(ManualCallsTest, StopNeedsNoLeaseAndReachesTheHand) {
  Take();
  grpc::ClientContext context;
  v1::StopReply reply;
  EXPECT_TRUE(control_->Stop(&context, v1::StopRequest(), &reply).ok());
  EXPECT_EQ(hand_.stops(), 1);
  EXPECT_EQ(GetStatus().lease().kind(), v1::LEASE_MANUAL);
}

TEST_F(ManualCallsTest, AJogIsHeldAndLetGo) {
  const uint64_t token = Take().token();
  grpc::ClientContext context;
  v1::JogReply reply;
  const auto stream = control_->Jog(&context, &reply);
  v1::JogRequest request;
  request.set_lease_token(token);
  request.set_axis(rig_.axes[0].name);
  request.set_rate_rad_s(0.25);
  EXPECT_TRUE(stream->Write(request));
  EXPECT_TRUE(stream->Write(request));
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(hand_.said(), (std::vector<std::string>{"jog 0 0.25", "jog 0 0.25", "jog 0 0"}));
}

TEST_F(ManualCallsTest, AMoveEndsWhenItsClientLeaves) {
  const uint64_t token = Take().token();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
  v1::MoveAxisRequest request;
  request.set_lease_token(token);
  request.set_axis(rig_.axes[0].name);
  request.set_target_rad(99);
  v1::ManualReply reply;
  EXPECT_FALSE(control_->MoveAxis(&context, request, &reply).ok());
  while (hand_.stops() == 0) std::this_thread::yield();
  EXPECT_EQ(hand_.stops(), 1);
}

// Every call that the table says needs the lease is refused with an old token, and with none.
TEST_F(ManualCallsTest, EveryCallThatNeedsTheLeaseIsRefusedWithoutIt) {
  const uint64_t old = Take().token();
  Take(true);
  const auto before = hand_.said();
  int checked = 0;
  const auto* service = v1::HelloRequest::descriptor()->file()->service(0);
  for (const CallRule& rule : CallTable()) {
    if (rule.lease == Lease::kNone) continue;
    const auto* method = service->FindMethodByName(std::string(rule.method.substr(8)));
    ASSERT_NE(method, nullptr) << rule.method;
    const auto* field = method->input_type()->FindFieldByName("lease_token");
    ASSERT_NE(field, nullptr) << rule.method << " cannot carry a token";
    for (const uint64_t token : {uint64_t{0}, old, old + 100}) {
      std::unique_ptr<google::protobuf::Message> request(
          google::protobuf::MessageFactory::generated_factory()
              ->GetPrototype(method->input_type())
              ->New());
      request->GetReflection()->SetUInt64(request.get(), field, token);
      if (const auto* axis = method->input_type()->FindFieldByName("axis")) {
        request->GetReflection()->SetString(request.get(), axis, rig_.axes[0].name);
      }
      if (const auto* plan = method->input_type()->FindFieldByName("plan_toml")) {
        request->GetReflection()->SetString(request.get(), plan, PlanText());
      }
      const AnyReply reply = AnyCall(channel_, PathOf(rule), {}, request->SerializeAsString());
      const bool resume =
          rule.method == "Control/ResumeSession";  // (it looks for its session first)
      EXPECT_EQ(reply.status.error_code(),
                resume ? grpc::StatusCode::NOT_FOUND : grpc::StatusCode::FAILED_PRECONDITION)
          << rule.method << " " << token << ": " << reply.status.error_message();
      ++checked;
    }
  }
  EXPECT_GE(checked, 3 * 10);
  EXPECT_EQ(hand_.said(), before);
  EXPECT_TRUE(hand_.open());
}

TEST_F(ManualCallsTest, EveryAuditedCallIsRecordedWithItsOutcome) {
  for (const CallRule& rule : CallTable()) {
    if (!rule.audited) continue;
    const AnyReply reply = AnyCall(channel_, PathOf(rule));
    const auto entries = Entries(std::string(rule.method));
    if (rule.method == "Control/Stop") continue;  // from a queue: below
    ASSERT_EQ(entries.size(), 1u) << rule.method << " is not recorded before its outcome is told";
    const std::string outcome = entries[0]["outcome"];
    EXPECT_EQ(reply.status.ok(), outcome == "OK") << rule.method << ": " << outcome;
    EXPECT_THAT(outcome, HasSubstr(reply.status.error_message()));
    EXPECT_FALSE(entries[0]["name"].get<std::string>().empty());
    EXPECT_NE(entries[0]["role"], "none");
  }
  while (Entries("Control/Stop").empty()) std::this_thread::yield();
  EXPECT_TRUE(Entries("Control/GetStatus").empty());
}

TEST_F(ManualCallsTest, APlanIsRecordedByItsDigest) {
  v1::RunReply reply;
  const std::string plan = PlanText() + "# " + std::string(500, 'x') + "\n";
  ASSERT_TRUE(Run(plan, &reply).ok());
  const auto entries = Entries("Control/Run");
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_THAT(entries[0]["what"].get<std::string>(), HasSubstr(Sha256(plan)));
  EXPECT_THAT(entries[0]["what"].get<std::string>(), HasSubstr("test.toml"));
  // The journal and the products' provenance carry the head of the log.
  grpc::ClientContext context;
  v1::SessionRequest request;
  request.set_session_id(reply.session_id());
  v1::SessionReply session;
  ASSERT_TRUE(frames_->GetSession(&context, request, &session).ok());
  const std::string text = AuditBytes();
  ChainVerifier verifier;
  const auto anchors = FindAnchors(session.audit_head());
  ASSERT_EQ(anchors.size(), 1u);
  verifier.Expect(anchors[0]);
  verifier.Add(text);
  EXPECT_TRUE(verifier.Finish().ok());
}

TEST_F(ManualCallsTest, TheLogIsReadFromAnywhere) {
  const std::string all = AuditBytes();
  for (uint64_t offset = 0; offset <= all.size() + 2; offset += 37) {
    EXPECT_EQ(AuditBytes(offset), offset < all.size() ? all.substr(offset) : "") << offset;
  }
  EXPECT_EQ(AuditBytes(~uint64_t{0}), "");
}

TEST(RefusalRecorder, AFloodIsCounted) {
  TemporaryFolder folder;
  auto log = AuditLog::Open(folder.path());
  ASSERT_TRUE(log.ok());
  RefusalRecorder recorder(**log);
  for (int i = 0; i < 10000; ++i) {
    recorder.Record({Role::kObserver, "eve", "x", ""}, "/mesorig.v1.Control/Run",
                    absl::PermissionDeniedError("no"));
  }
  log->reset();
  const auto report = VerifyChainFile(folder.path() / kAuditFile);
  ASSERT_TRUE(report.ok());
  EXPECT_TRUE(report->ok());
  EXPECT_GT(report->head.sequence, 100u);
  EXPECT_LT(report->head.sequence, 2000u);
}

TEST(EssentialFields, LongOnesAreTheirDigest) {
  v1::RunRequest request;
  request.set_plan_name("a \"quoted\"\nname");
  request.set_plan_toml(std::string(1000, 'p'));
  const std::string text = EssentialFields(request);
  EXPECT_THAT(text, HasSubstr(Sha256(std::string(1000, 'p'))));
  EXPECT_THAT(text, HasSubstr("1000 bytes"));
  EXPECT_EQ(text.find('\n'), std::string::npos);
  EXPECT_LT(text.size(), 300u);
}

}  // namespace
}  // namespace mesorig::daemon
