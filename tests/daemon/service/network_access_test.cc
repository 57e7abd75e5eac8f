// Every call, as every role, with every kind of certificate and token that must not get in; made
// from CallTable(), so that a new call is tested without a line here.

#include <openssl/ssl.h>

#include "protocol/wire/channel.h"
#include "tests/daemon/service/laboratory.h"

namespace mesorig::daemon {
namespace {

using grpc::StatusCode;
using wire::KeyAndCertificate;

const std::vector<std::string> kPeople = {"observer", "processing", "operator", "administrator"};

std::string Text(const AnyReply& reply) {
  return fmt::format("status {} \"{}\", reply \"{}\"", static_cast<int>(reply.status.error_code()),
                     reply.status.error_message(), reply.text);
}

// What a peer of `role` must get: the call, or a refusal that names both roles.
void ExpectByTable(const AnyReply& reply, const CallRule& rule, const std::string& role,
                   const std::string& who) {
  SCOPED_TRACE(fmt::format("{} as {}", rule.method, role));
  if (RoleNamed(role) >= rule.least) {
    EXPECT_TRUE(reply.status.ok()) << Text(reply);
    EXPECT_EQ(reply.text, role + " " + who);
    return;
  }
  EXPECT_EQ(reply.status.error_code(), StatusCode::PERMISSION_DENIED) << Text(reply);
  for (const std::string_view named : {Name(rule.least), std::string_view(role)}) {
    EXPECT_NE(reply.status.error_message().find(named), std::string::npos) << Text(reply);
  }
}

void ExpectRefused(const std::shared_ptr<grpc::Channel>& channel, StatusCode code,
                   const std::multimap<std::string, std::string>& metadata = {},
                   const std::string& why = "") {
  for (const CallRule& rule : CallTable()) {
    const AnyReply reply = AnyCall(channel, PathOf(rule), metadata);
    EXPECT_EQ(reply.status.error_code(), code) << rule.method << ": " << Text(reply);
    EXPECT_NE(reply.status.error_message().find(why), std::string::npos)
        << rule.method << ": " << Text(reply);
  }
}

TEST_F(NetworkAccessTest, EveryCallAsEveryRole) {
  Open(lab_.Options());
  for (const std::string& role : kPeople) {
    const KeyAndCertificate who = lab_.Make(role, "anna");
    const auto channel = DialAs(&who);
    for (const CallRule& rule : CallTable()) {
      ExpectByTable(AnyCall(channel, PathOf(rule)), rule, role, "anna");
    }
  }
}

TEST_F(NetworkAccessTest, EveryCallWithoutAGoodCertificateIsRefused) {
  Open(lab_.Options());
  ExpectRefused(DialAs(nullptr), StatusCode::UNAVAILABLE);
  wire::CertificateFields authority;
  authority.common_name = "lab";
  authority.authority = true;
  authority.not_before_s = lab_.now_s - kDay_s, authority.not_after_s = lab_.now_s + kDay_s;
  const KeyAndCertificate other_ca = wire::MakeCertificate(authority, nullptr).value();
  for (const std::string& role : kPeople) {
    SCOPED_TRACE(role);
    const wire::CertificateFields good = lab_.Fields(role, "eve");
    const KeyAndCertificate foreign = lab_.Make(good, &other_ca);
    ExpectRefused(DialAs(&foreign), StatusCode::UNAVAILABLE);
    wire::CertificateFields fields = good;
    fields.not_before_s = lab_.now_s - 2 * kDay_s, fields.not_after_s = lab_.now_s - 60;
    const KeyAndCertificate expired = lab_.Make(fields);
    ExpectRefused(DialAs(&expired), StatusCode::UNAVAILABLE);
    fields.not_before_s = lab_.now_s + 600, fields.not_after_s = lab_.now_s + kDay_s;
    const KeyAndCertificate early = lab_.Make(fields);
    ExpectRefused(DialAs(&early), StatusCode::UNAVAILABLE);
    fields = good;
    fields.extended_key_usage = "serverAuth";
    const KeyAndCertificate server = lab_.Make(fields);
    ExpectRefused(DialAs(&server), StatusCode::UNAVAILABLE);
    fields = good;
    fields.not_after_s = fields.not_before_s + 91 * kDay_s;
    const KeyAndCertificate lasting = lab_.Make(fields);
    ExpectRefused(DialAs(&lasting), StatusCode::UNAUTHENTICATED, {}, "91 days, at most 90");
    fields = good;
    fields.alternative_names.push_back("URI:mesorig:role:administrator");
    const KeyAndCertificate doubled = lab_.Make(fields);
    ExpectRefused(DialAs(&doubled), StatusCode::UNAUTHENTICATED, {}, "two URIs");
    fields.alternative_names = {"URI:mesorig:role:" + role};
    const KeyAndCertificate nameless = lab_.Make(fields);
    ExpectRefused(DialAs(&nameless), StatusCode::UNAUTHENTICATED, {}, "no URI");
    const KeyAndCertificate revoked = lab_.Make(good);
    const auto open = DialAs(&revoked);
    EXPECT_TRUE(AnyCall(open, "/mesorig.v1.Control/Hello").status.ok());
    lab_.Revoke(revoked);
    // The connection that stood before, and a new one.
    ExpectRefused(open, StatusCode::UNAUTHENTICATED, {}, "not on the list");
    ExpectRefused(DialAs(&revoked), StatusCode::UNAUTHENTICATED, {}, "not on the list");
  }
  for (const char* role : {"king", "none", "Operator", "daemon", "operator/x"}) {
    wire::CertificateFields fields = lab_.Fields("operator", "eve");
    fields.alternative_names = {std::string("URI:mesorig:role:") + role, "URI:mesorig:user:eve"};
    const KeyAndCertificate wrong = lab_.Make(fields);
    ExpectRefused(DialAs(&wrong), StatusCode::UNAUTHENTICATED);
  }
}

TEST_F(NetworkAccessTest, EveryCallThroughAGatewayIsTheUsers) {
  Open(lab_.Options());
  const KeyAndCertificate gateway = lab_.Make("gateway", "console");
  const auto channel = DialAs(&gateway);
  ExpectRefused(channel, StatusCode::UNAUTHENTICATED, {}, "gateway console: 0 tokens");
  for (const std::string& role : kPeople) {
    const KeyAndCertificate user = lab_.Make(role, "otto");
    const std::string token = lab_.TokenOf(user, gateway);
    for (const CallRule& rule : CallTable()) {
      ExpectByTable(AnyCall(channel, PathOf(rule), {{wire::kTokenKey, token}}), rule, role,
                    "otto via console");
    }
    lab_.Revoke(user);
    ExpectRefused(channel, StatusCode::UNAUTHENTICATED, {{wire::kTokenKey, token}},
                  "not on the list");
  }
}

TEST_F(NetworkAccessTest, EveryCallWithAWrongTokenIsRefused) {
  Open(lab_.Options());
  const KeyAndCertificate gateway = lab_.Make("gateway", "console");
  const KeyAndCertificate other = lab_.Make("gateway", "tablet");
  const auto channel = DialAs(&gateway);
  const auto refused = [&](const std::shared_ptr<grpc::Channel>& over, const std::string& token,
                           const std::string& why) {
    SCOPED_TRACE(why);
    ExpectRefused(over, StatusCode::UNAUTHENTICATED, {{wire::kTokenKey, token}}, why);
  };
  for (const std::string& role : kPeople) {
    SCOPED_TRACE(role);
    const KeyAndCertificate user = lab_.Make(role, "otto");
    const std::string token = lab_.TokenOf(user, gateway);
    refused(DialAs(&other), token, "another gateway");
    refused(DialAs(&user), token, "only gateways forward");
    EXPECT_TRUE(
        AnyCall(channel, "/mesorig.v1.Control/Hello", {{wire::kTokenKey, token}}).status.ok());
    // Its nonce served the first connection: the gateway's next one takes a new token.
    refused(DialAs(&gateway), token, "used before");
    refused(channel, lab_.TokenOf(user, gateway, lab_.now_s - 400, 300), "expired");
    refused(channel, lab_.TokenOf(user, gateway, lab_.now_s - 100, 500), "before the daemon began");
    refused(channel, lab_.TokenOf(user, gateway, lab_.now_s + 500), "in the future");
    ExpectRefused(channel, StatusCode::UNAUTHENTICATED,
                  {{wire::kTokenKey, token}, {wire::kTokenKey, token}}, "2 tokens");
    wire::CertificateFields fields = lab_.Fields(role, "otto");
    fields.not_before_s = lab_.now_s - 2 * kDay_s, fields.not_after_s = lab_.now_s - 60;
    refused(channel, lab_.TokenOf(lab_.Make(fields), gateway), "expired");
    std::string tampered = token;
    tampered[tampered.size() / 2] = tampered[tampered.size() / 2] == 'A' ? 'B' : 'A';
    refused(channel, tampered, "token");
  }
  // A gateway that forwards itself, or another gateway.
  refused(channel, lab_.TokenOf(gateway, gateway), "role \"gateway\"");
}

TEST_F(NetworkAccessTest, NothingButTls13GetsIn) {
  Open(lab_.Options());
  const KeyAndCertificate who = lab_.Make("administrator", "anna");
  // Plain TCP, by a client that knows no better and by ours, which does not even try.
  const auto plain = grpc::CreateChannel(access_->address(), grpc::InsecureChannelCredentials());
  EXPECT_EQ(AnyCall(plain, "/mesorig.v1.Control/Hello").status.error_code(),
            StatusCode::UNAVAILABLE);
  EXPECT_EQ(AnyCall(wire::MakeChannel(access_->address()), "/mesorig.v1.Control/Hello")
                .status.error_code(),
            StatusCode::UNAVAILABLE);
  for (const int version : {TLS1_2_VERSION, TLS1_3_VERSION}) {
    SSL_CTX* context = SSL_CTX_new(TLS_client_method());
    SSL_CTX_set_min_proto_version(context, version);
    SSL_CTX_set_max_proto_version(context, version);
    const auto dir = lab_.path(fmt::format("raw{}", version));
    std::filesystem::create_directories(dir);
    ASSERT_TRUE(WriteFileAtomically(dir / "pem", who.certificate_pem + who.key_pem).ok());
    ASSERT_EQ(SSL_CTX_use_certificate_file(context, (dir / "pem").c_str(), SSL_FILETYPE_PEM), 1);
    ASSERT_EQ(SSL_CTX_use_PrivateKey_file(context, (dir / "pem").c_str(), SSL_FILETYPE_PEM), 1);
    BIO* bio = BIO_new_ssl_connect(context);
    BIO_set_conn_hostname(bio, access_->address().c_str());
    SSL* ssl = nullptr;
    BIO_get_ssl(bio, &ssl);
    SSL_set_alpn_protos(ssl, reinterpret_cast<const unsigned char*>("\x02h2"), 3);
    EXPECT_EQ(BIO_do_connect(bio) == 1, version == TLS1_3_VERSION) << version;
    BIO_free_all(bio);
    SSL_CTX_free(context);
  }
}

TEST_F(NetworkAccessTest, OurClientComesInWithItsFolder) {
  Open(lab_.Options());
  ASSERT_TRUE(
      wire::IssueCertificate(lab_.ca_dir(), lab_.path("anna"), lab_.Fields("operator", "anna"))
          .ok());
  ASSERT_TRUE(WriteFileAtomically(lab_.tls_dir() / kAllowedFile,
                                  ReadFile(lab_.ca_dir() / "allowed").value())
                  .ok());
  wire::Address address("");
  address.host_port = access_->address();
  address.identity = lab_.path("anna");
  const auto channel = wire::ConnectTo(address, wire::kDaemonName);
  ASSERT_TRUE(channel.ok()) << channel.status();
  EXPECT_EQ(AnyCall(*channel, "/mesorig.v1.Control/Run").text, "operator anna");
  ASSERT_EQ(wire::RemoveFromList(lab_.tls_dir() / kAllowedFile, "anna").value(), 1);
  EXPECT_EQ(AnyCall(*channel, "/mesorig.v1.Control/Run").status.error_code(),
            StatusCode::UNAUTHENTICATED);
  address.identity = lab_.path("nobody");
  EXPECT_FALSE(wire::ConnectTo(address, wire::kDaemonName).ok());
}

TEST_F(NetworkAccessTest, AClientTrustsNoOtherDaemon) {
  Open(lab_.Options());
  const KeyAndCertificate who = lab_.Make("operator", "anna");
  wire::CertificateFields authority;
  authority.common_name = "lab";
  authority.authority = true;
  authority.not_before_s = lab_.now_s - kDay_s, authority.not_after_s = lab_.now_s + kDay_s;
  const KeyAndCertificate other_ca = wire::MakeCertificate(authority, nullptr).value();
  EXPECT_EQ(
      AnyCall(Dial(access_->address(), other_ca.certificate_pem, &who), "/mesorig.v1.Control/Hello")
          .status.error_code(),
      StatusCode::UNAVAILABLE);
}

TEST_F(NetworkAccessTest, CallsAreLimitedButNeverStop) {
  AccessOptions options = lab_.Options();
  options.gate.calls_per_s = 1, options.gate.burst = 5;
  options.gate.steady_s = [] { return 100.0; };
  Open(options);
  const KeyAndCertificate who = lab_.Make("observer", "anna");
  const auto channel = DialAs(&who);
  int let_in = 0;
  for (int i = 0; i < 20; ++i) {
    const AnyReply reply = AnyCall(channel, "/mesorig.v1.Control/GetStatus");
    let_in += reply.status.ok();
    EXPECT_TRUE(reply.status.ok() || reply.status.error_code() == StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_TRUE(AnyCall(channel, "/mesorig.v1.Control/Stop").status.ok());
  }
  EXPECT_EQ(let_in, 5);
  // Somebody else has calls of his own.
  const KeyAndCertificate other = lab_.Make("observer", "otto");
  EXPECT_TRUE(AnyCall(DialAs(&other), "/mesorig.v1.Control/GetStatus").status.ok());
}

TEST_F(NetworkAccessTest, OversizedRequestsAreRefused) {
  Open(lab_.Options());
  const KeyAndCertificate who = lab_.Make("operator", "anna");
  const auto channel = DialAs(&who);
  const auto call = [&](size_t bytes) {
    return AnyCall(channel, "/mesorig.v1.Control/Run", {}, std::string(bytes, 'x')).status;
  };
  EXPECT_TRUE(call(kMaxRequestBytes).ok());
  EXPECT_EQ(call(kMaxRequestBytes + 1).error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(call(1).ok());
}

TEST_F(NetworkAccessTest, DoorsThatCannotBeOpenedAreNamed) {
  auto endpoint = PublishedEndpoint::Claim(lab_.path("run"), "mesorigd").value();
  const auto why = [&](AccessOptions options) {
    return std::string(Message(Access::Create(options, endpoint, {&who_am_i_}).status()));
  };
  AccessOptions options = lab_.Options();
  options.listen = "nowhere";
  EXPECT_NE(why(options).find("HOST:PORT"), std::string::npos);
  options = lab_.Options();
  options.tls_dir = lab_.path("none");
  EXPECT_NE(why(options).find("ca.pem"), std::string::npos);
  options = lab_.Options();
  options.groups[Role::kOperator] = "no-such-group";
  EXPECT_NE(why(options).find("no-such-group"), std::string::npos);
}

}  // namespace
}  // namespace mesorig::daemon
