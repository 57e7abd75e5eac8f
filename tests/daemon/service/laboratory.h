#pragma once
// A laboratory's CA and everybody with a certificate of it, good and bad; and a daemon's doors on a
// port of this machine. Keys are made anew in every run: nothing depends on their bytes.

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "daemon/service/access.h"
#include "protocol/base/file_writer.h"
#include "protocol/wire/certificates.h"
#include "protocol/wire/token.h"
#include "tests/daemon/service/any_call.h"
#include "tests/daemon/session/session_fixture.h"

namespace mesorig::daemon {

constexpr int64_t kDay_s = 86400;

class Laboratory {
 public:
  Laboratory() {
    now_s = static_cast<int64_t>(std::time(nullptr));
    EXPECT_TRUE(wire::CreateAuthority(ca_dir(), "lab", now_s).ok());
    ca = {ReadFile(ca_dir() / "ca.key").value(), ReadFile(ca_dir() / "ca.pem").value()};
    const auto fields = wire::FieldsFor("daemon", "rig", {"127.0.0.1", "localhost"}, now_s, 30);
    EXPECT_TRUE(wire::IssueCertificate(ca_dir(), tls_dir(), fields.value()).ok());
    WriteAllowed();
  }
  std::filesystem::path ca_dir() const { return folder_.path() / "ca"; }
  std::filesystem::path tls_dir() const { return folder_.path() / "tls"; }
  std::filesystem::path path(const std::string& name) const { return folder_.path() / name; }

  wire::CertificateFields Fields(const std::string& role, const std::string& name) const {
    return wire::FieldsFor(role, name, {}, now_s, 30).value();
  }
  // Signed by the CA (or another), and on the list of those allowed.
  wire::KeyAndCertificate Make(const wire::CertificateFields& fields,
                               const wire::KeyAndCertificate* issuer = nullptr) {
    auto made = wire::MakeCertificate(fields, issuer ? issuer : &ca);
    EXPECT_TRUE(made.ok()) << made.status();
    const auto identity = wire::ReadIdentityPem(made->certificate_pem);
    if (identity.ok()) {
      allowed_ += wire::ListLine(*identity) + "\n";
      WriteAllowed();
    }
    return *std::move(made);
  }
  wire::KeyAndCertificate Make(const std::string& role, const std::string& name) {
    return Make(Fields(role, name));
  }
  void Revoke(const wire::KeyAndCertificate& who) {
    const std::string line = Print(who);
    const size_t at = allowed_.find(line);
    ASSERT_NE(at, std::string::npos);
    allowed_.erase(at, allowed_.find('\n', at) - at + 1);
    WriteAllowed();
  }
  static std::string Print(const wire::KeyAndCertificate& who) {
    return wire::ReadIdentityPem(who.certificate_pem).value().fingerprint;
  }
  std::string TokenOf(const wire::KeyAndCertificate& user, const wire::KeyAndCertificate& gateway,
                      int64_t issued_s = 0, int64_t life_s = wire::kTokenLife_s) const {
    return wire::MakeToken(user.key_pem, user.certificate_pem, Print(gateway),
                           issued_s == 0 ? now_s + 1 : issued_s, life_s)
        .value();
  }
  AccessOptions Options() const {
    AccessOptions options;
    options.listen = "127.0.0.1:0";
    options.tls_dir = tls_dir();
    return options;
  }

  int64_t now_s = 0;
  wire::KeyAndCertificate ca;

 private:
  void WriteAllowed() const {
    EXPECT_TRUE(
        WriteFileAtomically(tls_dir() / kAllowedFile, "# who may come in\n" + allowed_).ok());
  }
  TemporaryFolder folder_;
  std::string allowed_;
};

// A connection of its own. Null `who`: without a certificate.
inline std::shared_ptr<grpc::Channel> Dial(const std::string& address, const std::string& ca_pem,
                                           const wire::KeyAndCertificate* who) {
  grpc::SslCredentialsOptions options;
  options.pem_root_certs = ca_pem;
  if (who != nullptr) {
    options.pem_private_key = who->key_pem;
    options.pem_cert_chain = who->certificate_pem;
  }
  grpc::ChannelArguments arguments;
  arguments.SetInt("grpc.use_local_subchannel_pool", 1);
  return grpc::CreateCustomChannel(address, grpc::SslCredentials(options), arguments);
}

// The doors, with behind each call one that tells who came.
class NetworkAccessTest : public ::testing::Test {
 protected:
  void Open(AccessOptions options) {
    auto endpoint = PublishedEndpoint::Claim(lab_.path("run"), "mesorigd");
    ASSERT_TRUE(endpoint.ok()) << endpoint.status();
    endpoint_ = std::make_unique<PublishedEndpoint>(*std::move(endpoint));
    auto access = Access::Create(std::move(options), *endpoint_, {&who_am_i_});
    ASSERT_TRUE(access.ok()) << access.status();
    access_ = *std::move(access);
  }
  static void TearDownTestSuite() { fmt::print("{} calls were tried\n", any_calls.load()); }
  void TearDown() override {
    if (access_) access_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(5));
  }
  std::shared_ptr<grpc::Channel> DialAs(const wire::KeyAndCertificate* who) {
    return Dial(access_->address(), lab_.ca.certificate_pem, who);
  }

  Laboratory lab_;
  WhoAmI who_am_i_;
  std::unique_ptr<PublishedEndpoint> endpoint_;
  std::unique_ptr<Access> access_;
};

}  // namespace mesorig::daemon
