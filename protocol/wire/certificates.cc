#include "protocol/wire/certificates.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>

#include "protocol/base/file_writer.h"
#include "protocol/wire/openssl_owned.h"

namespace mesorig::wire {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kBackdated_s = 600;  // so that it is valid at once where clocks differ
constexpr size_t kMaxListBytes = 1u << 20;

using OwnedExtension = std::unique_ptr<X509_EXTENSION, FreeWith<X509_EXTENSION_free>>;
using OwnedNumber = std::unique_ptr<BIGNUM, FreeWith<BN_free>>;

OwnedKey KeyOfPem(std::string_view pem) {
  const OwnedBio bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  return OwnedKey(PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr));
}

std::string Drain(BIO& bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(&bio, &data);
  return {data, static_cast<size_t>(size)};
}

bool AddExtension(X509& certificate, X509V3_CTX& context, int nid, const std::string& value) {
  const OwnedExtension extension(X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str()));
  return extension != nullptr && X509_add_ext(&certificate, extension.get(), -1) == 1;
}

bool AddExtensions(X509& certificate, X509& issuer, const CertificateFields& fields) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, &issuer, &certificate, nullptr, nullptr, 0);
  std::string names;
  for (const std::string& name : fields.alternative_names)
    names += (names.empty() ? "" : ",") + name;
  const bool ca = fields.authority;
  return AddExtension(certificate, context, NID_basic_constraints,
                      ca ? "critical,CA:TRUE,pathlen:0" : "critical,CA:FALSE") &&
         AddExtension(certificate, context, NID_key_usage,
                      ca ? "critical,keyCertSign,cRLSign" : "critical,digitalSignature") &&
         AddExtension(certificate, context, NID_subject_key_identifier, "hash") &&
         (ca || AddExtension(certificate, context, NID_authority_key_identifier, "keyid")) &&
         (fields.extended_key_usage.empty() ||
          AddExtension(certificate, context, NID_ext_key_usage, fields.extended_key_usage)) &&
         (names.empty() || AddExtension(certificate, context, NID_subject_alt_name, names));
}

bool SetSerial(X509& certificate) {
  unsigned char bytes[16];
  if (RAND_bytes(bytes, sizeof(bytes)) != 1) return false;
  bytes[0] = static_cast<unsigned char>((bytes[0] & 0x7f) | 0x40);  // positive, of full length
  const OwnedNumber number(BN_bin2bn(bytes, sizeof(bytes), nullptr));
  return BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(&certificate)) != nullptr;
}

bool SetNames(X509& certificate, const X509& issuer, const std::string& common_name) {
  X509_NAME* subject = X509_get_subject_name(&certificate);
  return X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8,
                                    reinterpret_cast<const unsigned char*>(common_name.data()),
                                    static_cast<int>(common_name.size()), -1, 0) == 1 &&
         X509_set_issuer_name(&certificate, X509_get_subject_name(&issuer)) == 1;
}

// Never readable for anybody else, not even while it is written.
Status WriteKey(const fs::path& path, std::string_view pem) {
  MESORIG_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  if (::chmod(file.temporary_path().c_str(), S_IRUSR | S_IWUSR) != 0) {
    return Unavailable("{}: its mode cannot be set to 0600", path.string());
  }
  FILE* out = std::fopen(file.temporary_path().c_str(), "we");
  if (out == nullptr) return Unavailable("{}: cannot be written", path.string());
  const bool written = std::fwrite(pem.data(), 1, pem.size(), out) == pem.size();
  if (std::fclose(out) != 0 || !written) {
    return Unavailable("{}: cannot be written", path.string());
  }
  return file.Commit();
}

Status MakeFolder(const fs::path& dir, std::string_view must_not_have) {
  std::error_code error;
  fs::create_directories(dir, error);
  if (error) return InvalidArgument("{}: {}", dir.string(), error.message());
  if (fs::exists(dir / must_not_have)) {
    return FailedPrecondition("{}: is there already", (dir / must_not_have).string());
  }
  return OkStatus();
}

Status AppendLine(const fs::path& list, const std::string& line) {
  std::string text;
  if (fs::exists(list)) {
    MESORIG_ASSIGN_OR_RETURN(text, ReadFile(list, kMaxListBytes));
  }
  if (!text.empty() && text.back() != '\n') text += '\n';
  return WriteFileAtomically(list, text + line + "\n");
}

bool IsAddress(const std::string& host) {
  unsigned char bytes[16];
  return ::inet_pton(AF_INET, host.c_str(), bytes) == 1 ||
         ::inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

}  // namespace

StatusOr<CertificateFields> FieldsFor(std::string_view role, std::string_view name,
                                      const std::vector<std::string>& hosts, int64_t now_s,
                                      int days) {
  if (std::find(kCertificateRoles.begin(), kCertificateRoles.end(), role) ==
      kCertificateRoles.end()) {
    return InvalidArgument(
        "role \"{}\" is none of observer, processing, operator, administrator, "
        "gateway, daemon",
        role);
  }
  if (!ValidName(name)) {
    return InvalidArgument("name \"{}\" is not 1 to {} of a-z A-Z 0-9 . _ @ -", name,
                           kMaxNameLength);
  }
  if (days < 1 || days > kMaxDays) {
    return InvalidArgument("{} days are not in [1, {}]", days, kMaxDays);
  }
  const bool daemon = role == "daemon";
  if (daemon == hosts.empty()) {
    return InvalidArgument("role {}: {}", role,
                           daemon ? "its certificate names the hosts that it is reached by"
                                  : "only a daemon's certificate names hosts");
  }
  CertificateFields fields;
  fields.common_name = name;
  fields.alternative_names = {fmt::format("URI:mesorig:role:{}", role),
                              fmt::format("URI:mesorig:user:{}", name)};
  for (const std::string& host : hosts) {
    if (!IsAddress(host) && !ValidName(host)) {
      return InvalidArgument("\"{}\" is neither a host's name nor an address", host);
    }
    fields.alternative_names.push_back((IsAddress(host) ? "IP:" : "DNS:") + host);
  }
  fields.extended_key_usage = daemon ? "serverAuth" : "clientAuth";
  fields.not_before_s = now_s - kBackdated_s;
  fields.not_after_s = fields.not_before_s + int64_t{days} * 86400;
  return fields;
}

StatusOr<KeyAndCertificate> MakeCertificate(const CertificateFields& fields,
                                            const KeyAndCertificate* issuer) {
  const OwnedKey key(EVP_EC_gen("P-256"));
  const OwnedX509 certificate(X509_new());
  const OwnedX509 issuer_certificate = issuer ? ParsePem(issuer->certificate_pem) : nullptr;
  const OwnedKey issuer_key = issuer ? KeyOfPem(issuer->key_pem) : nullptr;
  if (issuer != nullptr && (issuer_certificate == nullptr || issuer_key == nullptr)) {
    return InvalidArgument("the CA's key or certificate cannot be read");
  }
  X509& by = issuer ? *issuer_certificate : *certificate;
  const bool made =
      key != nullptr && X509_set_version(certificate.get(), X509_VERSION_3) == 1 &&
      SetSerial(*certificate) && SetNames(*certificate, by, fields.common_name) &&
      ASN1_TIME_set(X509_getm_notBefore(certificate.get()), fields.not_before_s) != nullptr &&
      ASN1_TIME_set(X509_getm_notAfter(certificate.get()), fields.not_after_s) != nullptr &&
      X509_set_pubkey(certificate.get(), key.get()) == 1 &&
      AddExtensions(*certificate, by, fields) &&
      X509_sign(certificate.get(), issuer ? issuer_key.get() : key.get(), EVP_sha256()) > 0;
  if (!made) return Internal("certificate of {}: {}", fields.common_name, OpenSslError());
  const OwnedBio key_bio(BIO_new(BIO_s_mem())), certificate_bio(BIO_new(BIO_s_mem()));
  if (PEM_write_bio_PKCS8PrivateKey(key_bio.get(), key.get(), nullptr, nullptr, 0, nullptr,
                                    nullptr) != 1 ||
      PEM_write_bio_X509(certificate_bio.get(), certificate.get()) != 1) {
    return Internal("certificate of {}: {}", fields.common_name, OpenSslError());
  }
  return KeyAndCertificate{Drain(*key_bio), Drain(*certificate_bio)};
}

Status CreateAuthority(const fs::path& dir, std::string_view name, int64_t now_s) {
  if (!ValidName(name)) {
    return InvalidArgument("name \"{}\" is not 1 to {} of a-z A-Z 0-9 . _ @ -", name,
                           kMaxNameLength);
  }
  MESORIG_RETURN_IF_ERROR(MakeFolder(dir, "ca.key"));
  CertificateFields fields;
  fields.common_name = name;
  fields.authority = true;
  fields.not_before_s = now_s - kBackdated_s;
  fields.not_after_s = now_s + int64_t{kAuthorityDays} * 86400;
  MESORIG_ASSIGN_OR_RETURN(const KeyAndCertificate ca, MakeCertificate(fields, nullptr));
  MESORIG_RETURN_IF_ERROR(WriteKey(dir / "ca.key", ca.key_pem));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(dir / "ca.pem", ca.certificate_pem));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(dir / "issued", ""));
  return WriteFileAtomically(dir / "allowed", "");
}

StatusOr<Identity> IssueCertificate(const fs::path& ca_dir, const fs::path& out,
                                    const CertificateFields& fields) {
  KeyAndCertificate ca;
  MESORIG_ASSIGN_OR_RETURN(ca.key_pem, ReadFile(ca_dir / "ca.key", kMaxListBytes));
  MESORIG_ASSIGN_OR_RETURN(ca.certificate_pem, ReadFile(ca_dir / "ca.pem", kMaxListBytes));
  MESORIG_RETURN_IF_ERROR(MakeFolder(out, "key.pem"));
  MESORIG_ASSIGN_OR_RETURN(const KeyAndCertificate made, MakeCertificate(fields, &ca));
  MESORIG_ASSIGN_OR_RETURN(const Identity identity, ReadIdentityPem(made.certificate_pem));
  MESORIG_RETURN_IF_ERROR(WriteKey(out / "key.pem", made.key_pem));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(out / "cert.pem", made.certificate_pem));
  MESORIG_RETURN_IF_ERROR(WriteFileAtomically(out / "ca.pem", ca.certificate_pem));
  MESORIG_RETURN_IF_ERROR(AppendLine(ca_dir / "issued", ListLine(identity)));
  if (identity.role != "daemon") {
    MESORIG_RETURN_IF_ERROR(AppendLine(ca_dir / "allowed", ListLine(identity)));
  }
  return identity;
}

std::string ListLine(const Identity& identity) {
  std::tm parts{};
  const time_t end = identity.not_after_s;
  ::gmtime_r(&end, &parts);
  return fmt::format("{} {} {} {:04}-{:02}-{:02}T{:02}:{:02}Z", identity.fingerprint, identity.name,
                     identity.role, parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday,
                     parts.tm_hour, parts.tm_min);
}

StatusOr<int> RemoveFromList(const fs::path& list, std::string_view who) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(list, kMaxListBytes));
  std::string kept;
  int removed = 0;
  for (std::string_view rest = text; !rest.empty();) {
    const std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(rest.size(), line.size() + 1));
    const size_t space = line.find(' ');
    const std::string_view fingerprint = line.substr(0, space);
    std::string_view name = space == line.npos ? "" : line.substr(space + 1);
    name = name.substr(0, name.find(' '));
    if (fingerprint == who || name == who) {
      ++removed;
    } else {
      kept.append(line).append("\n");
    }
  }
  if (removed > 0) MESORIG_RETURN_IF_ERROR(WriteFileAtomically(list, kept));
  return removed;
}

}  // namespace mesorig::wire
