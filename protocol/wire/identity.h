#pragma once
// Who a certificate stands for. The laboratory's certificates carry two URIs among their subject
// alternative names: `mesorig:role:operator` and `mesorig:user:anna`. Pure functions on bytes from
// outside; any thread.

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace mesorig::wire {

inline constexpr size_t kMaxCertificateBytes = 8192;  // DER
inline constexpr size_t kMaxNameLength = 64;
// Of certificates: the daemon's roles (daemon/service/caller.h), gateways, and the daemon itself.
inline constexpr std::array<std::string_view, 6> kCertificateRoles = {
    "observer", "processing", "operator", "administrator", "gateway", "daemon"};

struct Identity {
  std::string role;         // as it stands in the URI: "operator", "gateway", "daemon"
  std::string name;         // of the person, gateway or machine
  std::string fingerprint;  // SHA-256 of the DER, 64 lower-case hexadecimal digits
  int64_t not_before_s = 0, not_after_s = 0;  // of its validity, seconds since 1970
  double days() const { return static_cast<double>(not_after_s - not_before_s) / 86400; }
};

// The first certificate of `pem`, or one in DER. Says nothing about who signed it.
// InvalidArgument: no certificate, larger than kMaxCertificateBytes, not exactly one role URI and
// one user URI, another `mesorig:` URI, a name that is not ValidName.
StatusOr<Identity> ReadIdentityPem(std::string_view pem);
StatusOr<Identity> ReadIdentityDer(std::string_view der);

// 1 to 64 of a-z A-Z 0-9 . _ @ -, the first not one of `.` and `-`: harmless in logs, files, URIs.
bool ValidName(std::string_view name);

}  // namespace mesorig::wire
