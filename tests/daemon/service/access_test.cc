// The doors of the daemon, from outside: local sockets of the roles.

#include "daemon/service/access.h"

#include <sys/stat.h>
#include <unistd.h>

#include "tests/daemon/service/any_call.h"
#include "tests/daemon/service/service_fixture.h"

namespace mesorig::daemon {
namespace {

class LocalAccessTest : public ServiceTest {
 protected:
  std::unique_ptr<v1::Control::Stub> As(std::string_view role) {
    const auto endpoint = wire::LocalEndpoint(folder_.path() / "run", wire::kDaemonName, role);
    EXPECT_TRUE(endpoint.ok()) << endpoint.status();
    return v1::Control::NewStub(wire::MakeChannel(endpoint.value_or("")));
  }
  template <typename Method, typename Request, typename Reply>
  static grpc::Status Call(v1::Control::Stub& stub, Method method, const Request& request,
                           Reply reply) {
    grpc::ClientContext context;
    return (stub.*method)(&context, request, &reply);
  }
};

TEST_F(LocalAccessTest, EachRoleHasASocketOfItsOwner) {
  for (const char* role : {"observer", "processing", "operator", "administrator"}) {
    struct stat status {};
    const auto path = folder_.path() / "run" / fmt::format("mesorigd.{}.sock", role);
    ASSERT_EQ(::stat(path.c_str(), &status), 0) << path;
    EXPECT_TRUE(S_ISSOCK(status.st_mode));
    EXPECT_EQ(status.st_mode & 0777, 0600u) << path;
    EXPECT_EQ(status.st_uid, ::geteuid());
  }
}

TEST_F(LocalAccessTest, TheSocketSaysTheRole) {
  using Stub = v1::Control::Stub;
  const auto observer = As("observer");
  EXPECT_TRUE(Call(*observer, &Stub::GetStatus, v1::StatusRequest(), v1::StatusReply()).ok());
  EXPECT_TRUE(Call(*observer, &Stub::Stop, v1::StopRequest(), v1::StopReply()).ok());
  const grpc::Status refused = Call(*observer, &Stub::Abort, v1::AbortRequest(), v1::AbortReply());
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::PERMISSION_DENIED);
  EXPECT_NE(refused.error_message().find("Control/Abort takes the role operator"),
            std::string::npos)
      << refused.error_message();
  EXPECT_NE(refused.error_message().find("has observer"), std::string::npos);
  EXPECT_TRUE(sequencer_.commands().empty());
  EXPECT_TRUE(Call(*As("operator"), &Stub::Abort, v1::AbortRequest(), v1::AbortReply()).ok());
  EXPECT_EQ(sequencer_.commands().size(), 1u);
}

TEST_F(LocalAccessTest, AMethodThatIsNotInTheTableIsRefused) {
  const auto endpoint = wire::LocalEndpoint(folder_.path() / "run", wire::kDaemonName);
  ASSERT_TRUE(endpoint.ok()) << endpoint.status();
  const grpc::Status status =
      AnyCall(wire::MakeChannel(*endpoint), "/mesorig.v1.Control/Explode").status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED) << status.error_message();
}

TEST_F(LocalAccessTest, AShutdownTakesTheSocketsAway) {
  access_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(1));
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "run" / "mesorigd.observer.sock"));
  grpc::ClientContext context;
  v1::StatusReply reply;
  EXPECT_EQ(control_->GetStatus(&context, v1::StatusRequest(), &reply).error_code(),
            grpc::StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace mesorig::daemon
