#pragma once
// Endpoints are never fixed: a service binds a socket path (or port 0) and publishes where it
// listens as a small file `<name>.endpoint` in a runtime directory; clients look there. Tests
// and rigs run side by side, each in a directory of its own.

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/claim.h"
#include "protocol/base/status.h"

namespace mesorig {

inline constexpr size_t kMaxSocketPath = 107;  // of the kernel

// $MESORIG_RUNTIME_DIR, else $XDG_RUNTIME_DIR/mesorig, else /tmp/mesorig-<uid>.
std::filesystem::path DefaultRuntimeDir();

// Publishes an endpoint for the life of the object and claims the name: a second process that
// claims it while this one lives gets FailedPrecondition ("already running, process N").
class PublishedEndpoint {
 public:
  // Creates `dir` if need be and locks `<name>.lock`. Refuses a directory whose socket paths
  // would exceed the 107 bytes of a unix socket's name.
  static StatusOr<PublishedEndpoint> Claim(const std::filesystem::path& dir, std::string_view name);
  PublishedEndpoint(PublishedEndpoint&& other) noexcept = default;
  PublishedEndpoint& operator=(PublishedEndpoint&&) = delete;
  ~PublishedEndpoint();  // removes the file and gives the claim back
  // Where this service may bind its socket; a stale one of a dead owner is removed at Claim.
  std::filesystem::path socket_path() const;
  // Makes the service findable: call once it listens.
  Status Publish(std::string_view endpoint);

 private:
  PublishedEndpoint(std::filesystem::path dir, std::string name, FileClaim claim)
      : dir_(std::move(dir)), name_(std::move(name)), claim_(std::move(claim)) {}
  std::filesystem::path dir_;
  std::string name_;
  FileClaim claim_;
};

// What `name` published, for example `unix:/run/…/mesorigd.sock` or `tcp:127.0.0.1:40123`.
// Unavailable: "mesorigd is not running (no …/mesorigd.endpoint)".
StatusOr<std::string> FindEndpoint(const std::filesystem::path& dir, std::string_view name);

}  // namespace mesorig
