#include "protocol/wire/identity.h"

#include <openssl/err.h>
#include <openssl/pem.h>

#include <algorithm>
#include <ctime>

#include "protocol/base/digest.h"
#include "protocol/wire/openssl_owned.h"

namespace mesorig::wire {
namespace {

constexpr std::string_view kOurs = "mesorig:", kRole = "mesorig:role:", kUser = "mesorig:user:";

StatusOr<int64_t> UnixSeconds(const ASN1_TIME* time) {
  std::tm parts{};
  if (time == nullptr || ASN1_TIME_to_tm(time, &parts) != 1) {
    return InvalidArgument("certificate: its validity is no time");
  }
  return static_cast<int64_t>(::timegm(&parts));
}

// Sets one of role and name by a URI of ours; others are nobody's business.
Status TakeUri(std::string_view uri, Identity& identity) {
  if (!uri.starts_with(kOurs)) return OkStatus();
  const bool role = uri.starts_with(kRole);
  if (!role && !uri.starts_with(kUser)) {
    return InvalidArgument("certificate: a URI that is neither {}... nor {}...", kRole, kUser);
  }
  std::string& field = role ? identity.role : identity.name;
  const std::string_view value = uri.substr(role ? kRole.size() : kUser.size());
  if (!field.empty()) return InvalidArgument("certificate: two URIs {}...", role ? kRole : kUser);
  if (!ValidName(value)) {
    return InvalidArgument(
        "certificate: the value of its URI {}... is not 1 to {} of a-z A-Z 0-9 . _ @ -",
        role ? kRole : kUser, kMaxNameLength);
  }
  field = value;
  return OkStatus();
}

StatusOr<Identity> Read(const X509& certificate) {
  Identity identity;
  const std::string der = ToDer(certificate);
  if (der.empty() || der.size() > kMaxCertificateBytes) {
    return InvalidArgument("certificate: {} bytes, 1 to {} are read", der.size(),
                           kMaxCertificateBytes);
  }
  identity.fingerprint = Sha256(der);
  MESORIG_ASSIGN_OR_RETURN(identity.not_before_s, UnixSeconds(X509_get0_notBefore(&certificate)));
  MESORIG_ASSIGN_OR_RETURN(identity.not_after_s, UnixSeconds(X509_get0_notAfter(&certificate)));
  int found = 0;  // -1: none, -2: the extension is there twice
  const OwnedNames names(static_cast<GENERAL_NAMES*>(
      X509_get_ext_d2i(&certificate, NID_subject_alt_name, &found, nullptr)));
  if (names == nullptr) ERR_clear_error();
  for (int i = 0; names != nullptr && i < sk_GENERAL_NAME_num(names.get()); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(names.get(), i);
    if (name->type != GEN_URI) continue;
    const ASN1_IA5STRING* uri = name->d.uniformResourceIdentifier;
    const auto* text = reinterpret_cast<const char*>(ASN1_STRING_get0_data(uri));
    MESORIG_RETURN_IF_ERROR(
        TakeUri({text, static_cast<size_t>(ASN1_STRING_length(uri))}, identity));
  }
  if (identity.role.empty() || identity.name.empty()) {
    return InvalidArgument("certificate: no URI {}ROLE or no URI {}NAME", kRole, kUser);
  }
  return identity;
}

}  // namespace

std::string OpenSslError() {
  char text[256] = "unknown error";
  if (const unsigned long code = ERR_peek_last_error(); code != 0) {
    ERR_error_string_n(code, text, sizeof(text));
  }
  ERR_clear_error();
  return text;
}

OwnedX509 ParsePem(std::string_view pem) {
  if (pem.size() > 16 * kMaxCertificateBytes) return nullptr;
  const OwnedBio bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  OwnedX509 certificate(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr));
  ERR_clear_error();
  return certificate;
}

OwnedX509 ParseDer(std::string_view der) {
  if (der.size() > kMaxCertificateBytes) return nullptr;
  const auto* at = reinterpret_cast<const unsigned char*>(der.data());
  const auto* end = at + der.size();
  OwnedX509 certificate(d2i_X509(nullptr, &at, static_cast<long>(der.size())));
  ERR_clear_error();
  return at == end ? std::move(certificate) : nullptr;
}

std::string ToDer(const X509& certificate) {
  unsigned char* bytes = nullptr;
  const int size = i2d_X509(&certificate, &bytes);
  if (size <= 0) return {};
  std::string der(reinterpret_cast<const char*>(bytes), static_cast<size_t>(size));
  OPENSSL_free(bytes);
  return der;
}

StatusOr<Identity> ReadIdentityPem(std::string_view pem) {
  const OwnedX509 certificate = ParsePem(pem);
  if (certificate == nullptr) return InvalidArgument("no certificate in PEM");
  return Read(*certificate);
}

StatusOr<Identity> ReadIdentityDer(std::string_view der) {
  const OwnedX509 certificate = ParseDer(der);
  if (certificate == nullptr) return InvalidArgument("no certificate in DER");
  return Read(*certificate);
}

bool ValidName(std::string_view name) {
  const auto valid = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '@' || c == '-';
  };
  return !name.empty() && name.size() <= kMaxNameLength && name[0] != '.' && name[0] != '-' &&
         std::all_of(name.begin(), name.end(), valid);
}

}  // namespace mesorig::wire
