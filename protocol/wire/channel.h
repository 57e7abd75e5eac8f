#pragma once
// Client ends. Include the generated *.grpc.pb.h beside this in the .cc that calls a service.

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "protocol/base/status.h"

namespace grpc {
class Channel;
}

namespace mesorig::wire {

// Names under which the services publish their endpoints.
inline constexpr std::string_view kDaemonName = "mesorigd";
inline constexpr std::string_view kProcessingName = "mesorig-processd";
inline constexpr std::string_view kSimulatorName = "mesorig-sim";

// The role as which mesorig-processd comes (daemon/service/caller.h).
inline constexpr std::string_view kProcessingRole = "processing";

inline constexpr uint32_t kProtocolMajor = 1;

// A connection of its own to `endpoint`, "unix:PATH": one HTTP/2 connection is one core, so frames
// take a channel per camera. Messages up to 256 MiB. Connects on first use. Another endpoint is
// never reached without TLS: such a channel fails every call.
std::shared_ptr<grpc::Channel> MakeChannel(std::string_view endpoint);

// The socket of `name` in the runtime directory, "unix:PATH". mesorigd has one for each role:
// `role` ("observer", ...), or the one with the most rights that this user may open.
// Unavailable: not running; PermissionDenied: none that this user may open.
StatusOr<std::string> LocalEndpoint(const std::filesystem::path& runtime_dir, std::string_view name,
                                    std::string_view role = "");

// Where a service is. From a path: in that runtime directory.
struct Address {
  // NOLINTNEXTLINE: a runtime directory is an address.
  Address(std::filesystem::path dir) : runtime_dir(std::move(dir)) {}
  Address(const std::string& dir) : runtime_dir(dir) {}
  Address(const char* dir) : runtime_dir(dir) {}
  std::filesystem::path runtime_dir;
  std::string host_port;  // over the network, by mutual TLS, if not empty
  std::filesystem::path
      identity;      // key.pem, cert.pem and ca.pem of the user: `mesorig certs issue`
  std::string role;  // of the local socket; empty: the most that there is
};

// Waits until `name` answers, at most `timeout_s`. Unavailable: "mesorigd is not running (...)" or
// "... does not answer"; over the network also what TLS refuses. InvalidArgument: the identity.
StatusOr<std::shared_ptr<grpc::Channel>> ConnectTo(const Address& address, std::string_view name,
                                                   double timeout_s = 5);

}  // namespace mesorig::wire
