#include "protocol/wire/channel.h"

#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include "protocol/base/file_writer.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/wire/grpc_alive.h"

namespace mesorig::wire {
namespace {

constexpr std::string_view kUnix = "unix:";
constexpr size_t kMaxPem = 1 << 16;

grpc::ChannelArguments Arguments() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(256 << 20);
  arguments.SetInt("grpc.use_local_subchannel_pool", 1);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 500);
  return arguments;
}

StatusOr<std::shared_ptr<grpc::Channel>> MakeTlsChannel(const Address& address) {
  KeepGrpcAlive();
  grpc::SslCredentialsOptions options;
  MESORIG_ASSIGN_OR_RETURN(options.pem_root_certs, ReadFile(address.identity / "ca.pem", kMaxPem));
  MESORIG_ASSIGN_OR_RETURN(options.pem_cert_chain,
                           ReadFile(address.identity / "cert.pem", kMaxPem));
  MESORIG_ASSIGN_OR_RETURN(options.pem_private_key,
                           ReadFile(address.identity / "key.pem", kMaxPem));
  return grpc::CreateCustomChannel(address.host_port, grpc::SslCredentials(options), Arguments());
}

bool MayOpen(std::string_view endpoint) {
  return !endpoint.starts_with(kUnix) ||
         ::access(std::string(endpoint.substr(kUnix.size())).c_str(), W_OK) == 0;
}

}  // namespace

std::shared_ptr<grpc::Channel> MakeChannel(std::string_view endpoint) {
  KeepGrpcAlive();
  // Nothing but a local socket goes without TLS.
  const std::string target =
      endpoint.starts_with(kUnix) ? std::string(endpoint) : "unix:/nonexistent/needs-tls";
  return grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), Arguments());
}

// Lines `ROLE ENDPOINT`, most rights first; or one endpoint for everybody.
StatusOr<std::string> LocalEndpoint(const std::filesystem::path& runtime_dir, std::string_view name,
                                    std::string_view role) {
  MESORIG_ASSIGN_OR_RETURN(const std::string published, FindEndpoint(runtime_dir, name));
  if (published.find(' ') == std::string::npos) return published;
  std::string_view rest = published;
  while (!rest.empty()) {
    const std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(rest.size(), line.size() + 1));
    const size_t space = line.find(' ');
    if (space == line.npos) continue;
    const std::string_view endpoint = line.substr(space + 1);
    if (role.empty() ? MayOpen(endpoint) : line.substr(0, space) == role) {
      return std::string(endpoint);
    }
  }
  return absl::PermissionDeniedError(
      fmt::format("{} in {}: this user may open none of its sockets{}{}", name,
                  runtime_dir.string(), role.empty() ? "" : ", or there is none of role ", role));
}

StatusOr<std::shared_ptr<grpc::Channel>> ConnectTo(const Address& address, std::string_view name,
                                                   double timeout_s) {
  std::string where = address.host_port;
  std::shared_ptr<grpc::Channel> channel;
  if (where.empty()) {
    MESORIG_ASSIGN_OR_RETURN(where, LocalEndpoint(address.runtime_dir, name, address.role));
    channel = MakeChannel(where);
  } else {
    MESORIG_ASSIGN_OR_RETURN(channel, MakeTlsChannel(address));
  }
  const auto deadline = std::chrono::system_clock::now() +
                        std::chrono::milliseconds(static_cast<int64_t>(timeout_s * 1000));
  if (!channel->WaitForConnected(deadline)) {
    return Unavailable("{} does not answer at {}{}", name, where,
                       address.host_port.empty() ? ""
                                                 : ", or one of the two refuses the other's "
                                                   "certificate (its log says which)");
  }
  return channel;
}

}  // namespace mesorig::wire
