#pragma once
// The daemon's doors (docs/access.md): a unix socket per role in the runtime directory and, when
// asked for, mutual TLS on a port. Every call of every service passes the Gate before any method
// sees it, in one place: the server's credentials.

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "daemon/service/audit_log.h"
#include "daemon/service/call_book.h"
#include "daemon/service/caller.h"
#include "daemon/service/gate.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/base/status.h"
#include "protocol/wire/listeners.h"

namespace grpc {
class Service;
}  // namespace grpc

namespace mesorig::daemon {

struct AccessOptions {
  // Whose members may open the socket of a role, beside the daemon's own user and root. Without an
  // entry: nobody else.
  std::map<Role, std::string> groups;
  std::string listen;             // "HOST:PORT", port 0: a free one; empty: no network
  std::filesystem::path tls_dir;  // key.pem, cert.pem, ca.pem, allowed: `mesorig certs`
  GateOptions gate;
  wire::ListenerLimits limits;
  CallLimits calls;
  std::chrono::milliseconds handshake{5000};  // until TLS and HTTP/2 are agreed on
  AuditLog* audit = nullptr;  // borrowed: records audited calls, and what is refused
};

// Files of the TLS folder.
inline constexpr std::string_view kAllowedFile = "allowed";

// Messages to the daemon are small but for plans.
inline constexpr int kMaxRequestBytes = 5 << 20;

// Thread-safe but for Create and Shutdown.
class Access {
 public:
  // Listens in the endpoint's directory and publishes there. Services are borrowed until Shutdown.
  // NotFound: a group; InvalidArgument: the TLS files or the address; FailedPrecondition: a socket.
  static StatusOr<std::unique_ptr<Access>> Create(AccessOptions options,
                                                  PublishedEndpoint& endpoint,
                                                  const std::vector<grpc::Service*>& services);
  virtual ~Access() = default;
  // Takes no connection any more; calls under way have until the deadline. The destructor does it.
  virtual void Shutdown(std::chrono::system_clock::time_point deadline) = 0;
  // Reads the list of allowed certificates again (SIGHUP; it is looked at anyhow when it changes).
  virtual void Reload() = 0;
  virtual size_t calls_under_way() const = 0;
  // What the health service tells of `service` ("": of the whole).
  virtual void SetServing(const std::string& service, bool serving) = 0;
  // "HOST:PORT" that is listened on; empty: none.
  virtual std::string address() const = 0;
};

}  // namespace mesorig::daemon
