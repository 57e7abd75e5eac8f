// The gate alone, with clocks that the test sets. What comes in over real doors:
// network_access_test.

#include "daemon/service/gate.h"

#include "tests/daemon/service/laboratory.h"

namespace mesorig::daemon {
namespace {

constexpr char kHello[] = "/mesorig.v1.Control/Hello", kRun[] = "/mesorig.v1.Control/Run",
               kStop[] = "/mesorig.v1.Control/Stop";

class GateTest : public ::testing::Test {
 protected:
  GateTest() : allowed_(lab_.tls_dir() / kAllowedFile) {
    unix_s_ = lab_.now_s;
    options_.steady_s = [this] { return steady_s_; };
    options_.unix_s = [this] { return unix_s_; };
    options_.on_refused = [this](std::string_view path, const Peer& peer, const Status& why) {
      told_.push_back(fmt::format("{} {} {}", path, peer.name, Message(why)));
    };
  }
  Gate Make() { return Gate(options_, &allowed_, lab_.ca.certificate_pem); }

  Laboratory lab_;
  AllowList allowed_;
  GateOptions options_;
  double steady_s_ = 0;
  int64_t unix_s_ = 0;
  std::vector<std::string> told_;
};

TEST_F(GateTest, ACertificateThatEndsEndsItsConnection) {
  const auto anna = lab_.Make("operator", "anna");
  Gate gate = Make();
  const Peer peer = gate.PeerOf(anna.certificate_pem, "1");
  EXPECT_EQ(peer.refusal, "");
  const auto caller = gate.Admit(kRun, peer, {});
  ASSERT_TRUE(caller.ok()) << caller.status();
  EXPECT_EQ(caller->role, Role::kOperator);
  EXPECT_EQ(caller->name, "anna");
  EXPECT_TRUE(gate.StillWelcome(peer, {}).ok());
  unix_s_ = peer.not_after_s;
  EXPECT_TRUE(absl::IsUnauthenticated(gate.Admit(kRun, peer, {}).status()));
  EXPECT_TRUE(absl::IsUnauthenticated(gate.Admit(kStop, peer, {}).status()));
  EXPECT_TRUE(absl::IsUnauthenticated(gate.StillWelcome(peer, {})));
}

TEST_F(GateTest, WithoutAListNobodyComesWithACertificate) {
  const auto anna = lab_.Make("operator", "anna");
  Gate gate(options_, nullptr, "");
  EXPECT_FALSE(gate.Admit(kHello, gate.PeerOf(anna.certificate_pem, "1"), {}).ok());
  Peer local;
  local.role = "observer", local.name = "otto", local.connection = "2";
  EXPECT_TRUE(gate.Admit(kHello, local, {}).ok());
}

TEST_F(GateTest, ATokenEndsWhileItIsUsed) {
  const auto anna = lab_.Make("operator", "anna"), console = lab_.Make("gateway", "console");
  Gate gate = Make();
  const Peer gateway = gate.PeerOf(console.certificate_pem, "1");
  const std::string token = lab_.TokenOf(anna, console, unix_s_, 60);
  const auto caller = gate.Admit(kRun, gateway, {token});
  ASSERT_TRUE(caller.ok()) << caller.status();
  EXPECT_EQ(caller->name, "anna");
  EXPECT_EQ(caller->via, "console");
  unix_s_ += 59;
  EXPECT_TRUE(gate.StillWelcome(gateway, {token}).ok());
  ++unix_s_;
  EXPECT_TRUE(absl::IsUnauthenticated(gate.StillWelcome(gateway, {token})));
  EXPECT_TRUE(absl::IsUnauthenticated(gate.Admit(kRun, gateway, {token}).status()));
  // The next one over the same connection.
  EXPECT_TRUE(gate.Admit(kRun, gateway, {lab_.TokenOf(anna, console, unix_s_, 60)}).ok());
}

TEST_F(GateTest, ARestartMakesNoTokenUsableAgain) {
  const auto anna = lab_.Make("operator", "anna"), console = lab_.Make("gateway", "console");
  const std::string token = lab_.TokenOf(anna, console, unix_s_, 300);
  {
    Gate gate = Make();
    EXPECT_TRUE(gate.Admit(kRun, gate.PeerOf(console.certificate_pem, "1"), {token}).ok());
  }
  unix_s_ += 5;
  Gate gate = Make();
  EXPECT_FALSE(gate.Admit(kRun, gate.PeerOf(console.certificate_pem, "1"), {token}).ok());
}

TEST_F(GateTest, RefusalsAreToldWithWhoAndWhyButNotWithoutEnd) {
  Gate gate = Make();
  Peer local;
  local.role = "observer", local.name = "otto", local.connection = "1";
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(gate.Admit(kRun, local, {}).ok());
  ASSERT_EQ(told_.size(), 20u);
  EXPECT_EQ(told_[0],
            std::string(kRun) + " otto Control/Run takes the role operator; otto has observer");
  steady_s_ += 3;
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(gate.Admit(kRun, local, {}).ok());
  EXPECT_EQ(told_.size(), 23u);
}

TEST_F(GateTest, PathsThatAreNoCallsAreRefused) {
  Gate gate = Make();
  Peer local;
  local.role = "administrator", local.name = "root", local.connection = "1";
  for (const std::string& path :
       {std::string(), std::string("/"), std::string(100'000, 'x'),
        std::string("/mesorig.v1.Control/"), std::string("/mesorig.v1.Control/Run\0", 24),
        std::string("/mesorig.v1.Processing/GetProducts")}) {
    EXPECT_TRUE(absl::IsPermissionDenied(gate.Admit(path, local, {}).status()));
  }
}

}  // namespace
}  // namespace mesorig::daemon
