#include "protocol/wire/certificates.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <random>

#include "protocol/base/file_writer.h"
#include "protocol/wire/token.h"
#include "tests/fixtures/damaged_text.h"

namespace mesorig::wire {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kNow = 1'800'000'000;

class CertificatesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "mesorig-certs-XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    dir_ = name;
    ASSERT_TRUE(CreateAuthority(dir_ / "ca", "lab", kNow).ok());
    ca_ = {ReadFile(dir_ / "ca" / "ca.key").value(), ReadFile(dir_ / "ca" / "ca.pem").value()};
  }
  void TearDown() override { fs::remove_all(dir_); }
  KeyAndCertificate Anna() const {
    return MakeCertificate(FieldsFor("operator", "anna", {}, kNow, 30).value(), &ca_).value();
  }
  fs::path dir_;
  KeyAndCertificate ca_;
};

TEST_F(CertificatesTest, AnIssuedCertificateSaysWhoItStandsFor) {
  const auto fields = FieldsFor("operator", "anna", {}, kNow, 30);
  ASSERT_TRUE(fields.ok()) << fields.status();
  const auto identity = IssueCertificate(dir_ / "ca", dir_ / "anna", *fields);
  ASSERT_TRUE(identity.ok()) << identity.status();
  EXPECT_EQ(identity->role, "operator");
  EXPECT_EQ(identity->name, "anna");
  EXPECT_EQ(identity->fingerprint.size(), 64u);
  EXPECT_DOUBLE_EQ(identity->days(), 30);
  for (const char* key : {"ca/ca.key", "anna/key.pem"}) {
    struct stat status {};
    ASSERT_EQ(::stat((dir_ / key).c_str(), &status), 0) << key;
    EXPECT_EQ(status.st_mode & 0777, 0600u) << key;
  }
  EXPECT_EQ(ReadFile(dir_ / "ca" / "allowed").value(), ListLine(*identity) + "\n");
  // Nothing is overwritten.
  EXPECT_TRUE(
      absl::IsFailedPrecondition(IssueCertificate(dir_ / "ca", dir_ / "anna", *fields).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(CreateAuthority(dir_ / "ca", "lab", kNow)));
}

TEST_F(CertificatesTest, RevokingTakesOffTheListByNameOrFingerprint) {
  std::vector<Identity> made;
  for (const char* name : {"anna", "otto", "anna"}) {
    const auto fields = FieldsFor("observer", name, {}, kNow, 1).value();
    made.push_back(
        IssueCertificate(dir_ / "ca", dir_ / fmt::format("{}", made.size()), fields).value());
  }
  const fs::path list = dir_ / "ca" / "allowed";
  EXPECT_EQ(RemoveFromList(list, "nobody").value(), 0);
  EXPECT_EQ(RemoveFromList(list, made[1].fingerprint).value(), 1);
  EXPECT_EQ(RemoveFromList(list, "anna").value(), 2);
  EXPECT_EQ(ReadFile(list).value(), "");
}

TEST_F(CertificatesTest, RefusesWhatItShouldNotSign) {
  const std::vector<std::string> none, rig = {"rig", "10.0.0.7", "::1"};
  EXPECT_TRUE(FieldsFor("daemon", "rig", rig, kNow, 30).ok());
  EXPECT_FALSE(FieldsFor("daemon", "rig", none, kNow, 30).ok());
  EXPECT_FALSE(FieldsFor("operator", "anna", rig, kNow, 30).ok());
  EXPECT_FALSE(FieldsFor("king", "anna", none, kNow, 30).ok());
  EXPECT_FALSE(FieldsFor("operator", "anna", none, kNow, 0).ok());
  EXPECT_FALSE(FieldsFor("operator", "anna", none, kNow, kMaxDays + 1).ok());
  EXPECT_FALSE(FieldsFor("daemon", "rig", {"a,URI:mesorig:role:administrator"}, kNow, 30).ok());
  for (const char* name : {"", "-x", ".x", "a b", "a,URI:x", "a/b", "a\n", "ä"}) {
    EXPECT_FALSE(FieldsFor("operator", name, none, kNow, 30).ok()) << name;
  }
  EXPECT_FALSE(FieldsFor("operator", std::string(65, 'a'), none, kNow, 30).ok());
}

TEST_F(CertificatesTest, IdentityTakesExactlyOneRoleAndOneUser) {
  const auto read = [&](const std::vector<std::string>& names) {
    CertificateFields fields = FieldsFor("operator", "anna", {}, kNow, 30).value();
    fields.alternative_names = names;
    return ReadIdentityPem(MakeCertificate(fields, &ca_).value().certificate_pem);
  };
  const std::string role = "URI:mesorig:role:operator", user = "URI:mesorig:user:anna";
  EXPECT_TRUE(read({role, user}).ok());
  EXPECT_TRUE(read({role, user, "URI:https://example.org", "DNS:x"}).ok());
  EXPECT_FALSE(read({}).ok());
  EXPECT_FALSE(read({role}).ok());
  EXPECT_FALSE(read({user}).ok());
  EXPECT_FALSE(read({role, role, user}).ok());
  EXPECT_FALSE(read({role, user, "URI:mesorig:user:otto"}).ok());
  EXPECT_FALSE(read({role, user, "URI:mesorig:right:all"}).ok());
  EXPECT_FALSE(read({"DNS:mesorig:role:operator", user}).ok());
  EXPECT_FALSE(read({"URI:mesorig:role:", user}).ok());
}

TEST_F(CertificatesTest, ATokenIsItsUsersForOneGatewayAndMinutes) {
  const KeyAndCertificate anna = Anna();
  const std::string gateway(64, 'a');
  const auto text = MakeToken(anna.key_pem, anna.certificate_pem, gateway, kNow, 60);
  ASSERT_TRUE(text.ok()) << text.status();
  EXPECT_LT(text->size(), 2000u);
  const TokenVerifier verifier(ca_.certificate_pem);
  const auto token = verifier.Verify(*text, kNow + 59);
  ASSERT_TRUE(token.ok()) << token.status();
  EXPECT_EQ(token->user.name, "anna");
  EXPECT_EQ(token->gateway, gateway);
  EXPECT_FALSE(verifier.Verify(*text, kNow + 60).ok());
  EXPECT_FALSE(verifier.Verify(*text, kNow - kClockSkew_s - 1).ok());
  EXPECT_FALSE(TokenVerifier("").Verify(*text, kNow).ok());
  // Another laboratory's CA of the same name.
  ASSERT_TRUE(CreateAuthority(dir_ / "other", "lab", kNow).ok());
  EXPECT_FALSE(TokenVerifier(ReadFile(dir_ / "other" / "ca.pem").value()).Verify(*text, kNow).ok());
  // Another's key, a life that is too long, a gateway that is none.
  EXPECT_FALSE(MakeToken(Anna().key_pem, anna.certificate_pem, gateway, kNow, 60).ok());
  EXPECT_FALSE(MakeToken(anna.key_pem, anna.certificate_pem, gateway, kNow, 601).ok());
  EXPECT_FALSE(MakeToken(anna.key_pem, anna.certificate_pem, "console", kNow, 60).ok());
}

TEST_F(CertificatesTest, ADamagedTokenIsNoToken) {
  const KeyAndCertificate anna = Anna();
  const std::string text =
      MakeToken(anna.key_pem, anna.certificate_pem, std::string(64, 'a'), kNow).value();
  const TokenVerifier verifier(ca_.certificate_pem);
  std::mt19937 random(5);
  int tried = 0;
  const auto refused = [&](const std::string& damaged) {
    if (damaged == text) return;
    ++tried;
    const auto token = verifier.Verify(damaged, kNow);
    EXPECT_FALSE(token.ok() && token->signed_part != ParseToken(text)->signed_part) << damaged;
    EXPECT_TRUE(token.ok() || absl::IsUnauthenticated(token.status())) << token.status();
  };
  for (size_t size = 0; size < text.size(); size += 7) refused(text.substr(0, size));
  for (int i = 0; i < 1000; ++i) {
    refused(test::Damaged(text, random, 1 + i % 4, "ABCDabcd0123+/="));
  }
  EXPECT_GT(tried, 1000);
}

TEST_F(CertificatesTest, ADamagedCertificateHarmsNothing) {
  const std::string pem = Anna().certificate_pem;
  std::mt19937 random(6);
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto identity =
        ReadIdentityPem(test::Damaged(pem, random, 1 + i % 4, "ABCDabcd0123+/=-\n"));
    if (!identity.ok()) {
      ++refused;
      continue;
    }
    EXPECT_TRUE(ValidName(identity->name) && ValidName(identity->role));
  }
  EXPECT_GT(refused, 200);
}

TEST_F(CertificatesTest, ATokenServesOneConnection) {
  const KeyAndCertificate anna = Anna();
  const TokenVerifier verifier(ca_.certificate_pem);
  TokenBook book(kNow);
  const auto make = [&](int64_t at) {
    return MakeToken(anna.key_pem, anna.certificate_pem, std::string(64, 'a'), at, 60).value();
  };
  const std::string text = make(kNow);
  EXPECT_EQ(book.Known(text, "1"), nullptr);
  EXPECT_TRUE(book.Enter(verifier.Verify(text, kNow).value(), text, "1", kNow).ok());
  EXPECT_NE(book.Known(text, "1"), nullptr);
  EXPECT_EQ(book.Known(text, "2"), nullptr);
  EXPECT_TRUE(absl::IsUnauthenticated(
      book.Enter(verifier.Verify(text, kNow).value(), text, "2", kNow).status()));
  // Before the book was opened: whether it was used then nobody knows.
  const std::string old = make(kNow - 1);
  EXPECT_FALSE(book.Enter(verifier.Verify(old, kNow).value(), old, "1", kNow).ok());
  // Ended ones make room; of those in force one user has so many.
  size_t entered = 1;
  for (;; ++entered) {
    const std::string next = make(kNow);
    if (!book.Enter(verifier.Verify(next, kNow).value(), next, "1", kNow).ok()) break;
  }
  EXPECT_EQ(entered, TokenBook::kMaxOfOneUser);
  const std::string later = make(kNow + 60);
  EXPECT_TRUE(book.Enter(verifier.Verify(later, kNow + 60).value(), later, "1", kNow + 60).ok());
}

}  // namespace
}  // namespace mesorig::wire
