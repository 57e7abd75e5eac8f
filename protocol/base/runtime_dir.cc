#include "protocol/base/runtime_dir.h"

#include <unistd.h>

#include <cstdlib>

#include "protocol/base/file_writer.h"

namespace mesorig {
namespace {

std::filesystem::path EndpointFile(const std::filesystem::path& dir, std::string_view name) {
  return dir / fmt::format("{}.endpoint", name);
}

}  // namespace

std::filesystem::path DefaultRuntimeDir() {
  if (const char* dir = std::getenv("MESORIG_RUNTIME_DIR"); dir != nullptr && *dir != 0) return dir;
  if (const char* dir = std::getenv("XDG_RUNTIME_DIR"); dir != nullptr && *dir != 0) {
    return std::filesystem::path(dir) / "mesorig";
  }
  return fmt::format("/tmp/mesorig-{}", ::getuid());
}

StatusOr<PublishedEndpoint> PublishedEndpoint::Claim(const std::filesystem::path& dir,
                                                     std::string_view name) {
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error) return InvalidArgument("runtime directory {}: {}", dir.string(), error.message());
  const auto absolute = std::filesystem::absolute(dir, error);
  const auto socket = absolute / fmt::format("{}.sock", name);
  if (socket.string().size() > kMaxSocketPath) {
    return InvalidArgument("runtime directory {}: its socket paths exceed {} bytes; choose a shorter one",
                           absolute.string(), kMaxSocketPath);
  }
  const auto lock = absolute / fmt::format("{}.lock", name);
  MESORIG_ASSIGN_OR_RETURN(
      FileClaim claim,
      FileClaim::Take(lock, fmt::format("{} already runs in {}", name, absolute.string())));
  std::filesystem::remove(EndpointFile(absolute, name), error);
  std::filesystem::remove(socket, error);
  return PublishedEndpoint(absolute, std::string(name), std::move(claim));
}

PublishedEndpoint::~PublishedEndpoint() {
  if (name_.empty()) return;  // moved from
  std::error_code ignored;
  std::filesystem::remove(EndpointFile(dir_, name_), ignored);
  std::filesystem::remove(socket_path(), ignored);
}

std::filesystem::path PublishedEndpoint::socket_path() const {
  return dir_ / fmt::format("{}.sock", name_);
}

Status PublishedEndpoint::Publish(std::string_view endpoint) {
  return WriteFileAtomically(EndpointFile(dir_, name_), endpoint);
}

StatusOr<std::string> FindEndpoint(const std::filesystem::path& dir, std::string_view name) {
  const auto file = EndpointFile(dir, name);
  auto endpoint = ReadFile(file, 4096);
  if (!endpoint.ok()) {
    return Unavailable("{} is not running (no {})", name, file.string());
  }
  return endpoint;
}

}  // namespace mesorig
