#pragma once
// A laboratory's own certificates: a CA, and what it signs for people, gateways and daemons
// (docs/access.md). Keys are EC P-256. Any thread; files are written whole, keys for their owner
// only.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "protocol/base/status.h"
#include "protocol/wire/identity.h"

namespace mesorig::wire {

struct KeyAndCertificate {
  std::string key_pem, certificate_pem;
};

struct CertificateFields {
  std::string common_name;
  std::vector<std::string>
      alternative_names;           // "URI:mesorig:role:operator", "DNS:rig", "IP:10.0.0.7"
  std::string extended_key_usage;  // "clientAuth", "serverAuth"; empty for a CA
  int64_t not_before_s = 0, not_after_s = 0;  // seconds since 1970
  bool authority = false;
};

// What IssueCertificate asks for; people and gateways get clientAuth, daemons serverAuth.
// InvalidArgument: a role that is none of kCertificateRoles, a name or host that is not ValidName
// (hosts may also be IP addresses), days outside [1, kMaxDays], a daemon without a host.
StatusOr<CertificateFields> FieldsFor(std::string_view role, std::string_view name,
                                      const std::vector<std::string>& hosts, int64_t now_s,
                                      int days);
inline constexpr int kDefaultDays = 30, kMaxDays = 90, kAuthorityDays = 3650;

// `issuer` null: signed by itself. Internal: OpenSSL says no.
StatusOr<KeyAndCertificate> MakeCertificate(const CertificateFields& fields,
                                            const KeyAndCertificate* issuer);

// Makes `dir` with ca.key (0600), ca.pem, and empty lists issued and allowed. FailedPrecondition:
// there is a CA already.
Status CreateAuthority(const std::filesystem::path& dir, std::string_view name, int64_t now_s);

// Signs with the CA of `ca_dir` and writes key.pem (0600), cert.pem and ca.pem into `out`, which
// must not have them. Enters it in the CA's lists: issued, and for whoever calls a daemon also
// allowed.
StatusOr<Identity> IssueCertificate(const std::filesystem::path& ca_dir,
                                    const std::filesystem::path& out,
                                    const CertificateFields& fields);

// A line of the lists: `FINGERPRINT NAME ROLE END`.
std::string ListLine(const Identity& identity);

// Takes the lines of a fingerprint, or of a name, out of such a list. Returns how many there were.
StatusOr<int> RemoveFromList(const std::filesystem::path& list, std::string_view who);

}  // namespace mesorig::wire
