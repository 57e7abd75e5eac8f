#pragma once
// Decides each call before any method of ours sees it: who it is, whether its role suffices by
// CallTable(), whether it comes too often. No gRPC in here: access.cc puts it in front of the
// server.

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/service/allow_list.h"
#include "daemon/service/caller.h"
#include "daemon/service/rate_limit.h"
#include "protocol/base/mutex.h"
#include "protocol/base/status.h"
#include "protocol/wire/token.h"

namespace mesorig::daemon {

// Whose a connection is, established once at its first call.
struct Peer {
  std::string connection;   // tells connections apart
  std::string role, name;   // of the socket and uid, or of the certificate
  std::string fingerprint;  // of the certificate; empty: a local socket
  int64_t not_after_s = 0;  // of the certificate, seconds since 1970
  std::string refusal;      // why nobody comes in over this connection; empty: somebody may
};

struct GateOptions {
  double calls_per_s = 500, burst = 1000;         // of one caller
  double refusals_per_s = 1, refusal_burst = 20;  // of one connection, that are logged and told
  double max_certificate_days = 90;               // notAfter - notBefore
  std::function<double()> steady_s;               // default: the steady clock
  std::function<int64_t()> unix_s;                // default: the system's clock
  // Told of a refusal, for the audit log. Any thread; must not wait.
  std::function<void(std::string_view path, const Peer& peer, const Status& why)> on_refused;
};

// Thread-safe; holds its lock for microseconds and waits for nothing: Stop comes through here.
class Gate {
 public:
  // Borrows the list, which may be null: then nobody comes in with a certificate. `ca_pem` signs
  // users' certificates in tokens.
  Gate(GateOptions options, AllowList* allowed, std::string ca_pem);

  // A certificate's peer as of `pem`; its refusal tells what is wrong with the certificate itself.
  Peer PeerOf(std::string_view pem, std::string connection) const;

  // Who calls, if he may call `path` ("/mesorig.v1.Control/Run"). `tokens`: the values of the
  // call's kTokenKey. UNAUTHENTICATED: it is not known who; PERMISSION_DENIED: no such call, or the
  // role does not suffice (names both); RESOURCE_EXHAUSTED: too often (never Stop).
  StatusOr<Caller> Admit(std::string_view path, const Peer& peer,
                         const std::vector<std::string_view>& tokens);
  // Never limited.
  static bool IsStop(std::string_view path);
  // Of a stream that goes on: whether its caller still is who he was. Counts nothing.
  Status StillWelcome(const Peer& peer, const std::vector<std::string_view>& tokens);

 private:
  StatusOr<Caller> Identify(const Peer& peer, const std::vector<std::string_view>& tokens);
  StatusOr<Caller> IdentifyByToken(const Peer& gateway, std::string_view token);
  Status CheckCertificate(const Peer& peer) const;
  void Tell(std::string_view path, const Peer& peer, const Status& why, double now_s);
  StatusOr<Caller> Decide(std::string_view path, const Peer& peer,
                          const std::vector<std::string_view>& tokens);

  const GateOptions options_;
  AllowList* const allowed_;
  const wire::TokenVerifier verifier_;
  Mutex mutex_;
  RateLimit calls_ GUARDED_BY(mutex_);
  RateLimit refusals_ GUARDED_BY(mutex_);
  wire::TokenBook tokens_ GUARDED_BY(mutex_);
};

}  // namespace mesorig::daemon
