#include "daemon/app/check_settings.h"

#include <arpa/inet.h>
#include <fmt/ranges.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "daemon/app/state_claim.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/rig/rig.h"
#include "protocol/wire/channel.h"

namespace mesorig::daemon {
namespace {

namespace fs = std::filesystem;

// The folder, or the first above it that exists, takes files from us.
Status CheckFolder(const char* name, const std::string& folder) {
  if (folder.empty()) return InvalidArgument("{}: not said", name);
  std::error_code error;
  fs::path existing = fs::absolute(folder, error);
  while (!fs::exists(existing, error) && existing.has_relative_path()) {
    existing = existing.parent_path();
  }
  if (!fs::is_directory(existing, error)) {
    return InvalidArgument("{} {}: {} is no folder", name, folder, existing.string());
  }
  if (::access(existing.c_str(), W_OK | X_OK) != 0) {
    return InvalidArgument("{} {}: {} cannot be written: {}", name, folder, existing.string(),
                           std::strerror(errno));
  }
  return OkStatus();
}

Status CheckPort(int port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int yes = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  const bool bound = ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
  const int why = errno;
  ::close(fd);
  if (bound) return OkStatus();
  return InvalidArgument("metrics.port: 127.0.0.1:{}: {}", port, std::strerror(why));
}

bool IsProgram(const fs::path& path) {
  struct stat file {};
  return ::stat(path.c_str(), &file) == 0 && S_ISREG(file.st_mode) &&
         ::access(path.c_str(), X_OK) == 0;
}

Status CheckProgram(const char* name, const std::string& program) {
  if (program.find('/') != program.npos) {
    if (IsProgram(program)) return OkStatus();
    return InvalidArgument("{}: {} is no program that can be run", name, program);
  }
  const char* path = std::getenv("PATH");
  std::string_view folders = path == nullptr ? "/usr/bin:/bin" : path;
  while (!folders.empty()) {
    const std::string_view folder = folders.substr(0, folders.find(':'));
    folders.remove_prefix(std::min(folders.size(), folder.size() + 1));
    if (IsProgram(fs::path(folder) / program)) return OkStatus();
  }
  return InvalidArgument("{}: there is no program {} in PATH", name, program);
}

class Findings {
 public:
  void Add(const Status& status) {
    if (!status.ok()) wrong_.emplace_back(Message(status));
  }
  Status Result() const {
    if (wrong_.empty()) return OkStatus();
    return InvalidArgument("{}", fmt::join(wrong_, "\n"));
  }

 private:
  std::vector<std::string> wrong_;
};

}  // namespace

Status CheckSettings(const Settings& settings) {
  Findings findings;
  fmt::print("{}", SettingsText(settings));
  std::fflush(stdout);
  if (const auto rig = LoadRig(settings.rig); rig.ok()) {
    fmt::print("\n# rig {}: {} axes, {} lamps, {} cameras{}\n", rig->name, rig->axes.size(),
               rig->lamps.size(), rig->cameras.size(), rig->laser ? ", a laser" : "");
  } else {
    findings.Add(rig.status());
  }
  findings.Add(CheckFolder("state_dir", settings.state_dir));
  findings.Add(CheckFolder("runtime_dir", settings.runtime_dir));
  bool runs = false;  // then its port is taken, rightly
  std::error_code error;
  if (fs::exists(StateClaimFile(settings.state_dir), error)) {
    const auto claim = ClaimState(settings.state_dir);
    runs = absl::IsFailedPrecondition(claim.status());
    if (runs) fmt::print("# {}\n", Message(claim.status()));
    if (!claim.ok() && !runs) findings.Add(claim.status());
  }
  const auto socket = fs::absolute(settings.runtime_dir, error) /
                      fmt::format("{}.sock", wire::kDaemonName);
  if (socket.string().size() > kMaxSocketPath) {
    findings.Add(InvalidArgument("runtime_dir {}: its socket paths exceed {} bytes",
                                 settings.runtime_dir, kMaxSocketPath));
  }
  if (settings.metrics_port && !runs) findings.Add(CheckPort(*settings.metrics_port));
  if (!settings.notify.command.empty()) {
    findings.Add(CheckProgram("notify.command", settings.notify.command.front()));
  }
  if (!settings.notify.webhook.empty()) {
    findings.Add(CheckProgram("notify.webhook", settings.notify.curl));
  }
  return findings.Result();
}

}  // namespace mesorig::daemon
