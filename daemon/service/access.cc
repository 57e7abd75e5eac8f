#include "daemon/service/access.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>

#include "daemon/service/audit_interceptor.h"
#include "daemon/service/auth_properties.h"
#include "protocol/base/file_writer.h"
#include "protocol/base/log.h"
#include "protocol/wire/grpc_status.h"
#include "protocol/wire/health.h"
#include "protocol/wire/server.h"
#include "protocol/wire/token.h"

namespace mesorig::daemon {
namespace {

using Acceptor = grpc::experimental::ExternalConnectionAcceptor;
using Metadata = std::multimap<grpc::string_ref, grpc::string_ref>;

constexpr std::array kSocketRoles = {Role::kAdministrator, Role::kOperator, Role::kProcessing,
                                     Role::kObserver};
// gRPC does not say which accepted socket a call came over, but which credentials: each pair of
// role and uid gets credentials of its own when it first comes.
constexpr size_t kLocalCallers = 64;
constexpr std::string_view kCaFile = "ca.pem", kCertificateFile = "cert.pem", kKeyFile = "key.pem";
constexpr unsigned kRereadCertificate_s = 60;  // a renewed one needs no restart

std::string_view View(grpc::string_ref text) { return {text.data(), text.size()}; }

std::vector<std::string_view> TokensIn(const Metadata& metadata) {
  std::vector<std::string_view> tokens;
  const auto [from, to] = metadata.equal_range(wire::kTokenKey);
  for (auto at = from; at != to; ++at) tokens.push_back(View(at->second));
  return tokens;
}

// In front of all methods. One for the network, one for each pair of role and uid.
class Processor final : public grpc::AuthMetadataProcessor {
 public:
  // `refusals` may be null.
  Processor(Gate& gate, CallBook& calls, std::atomic<uint64_t>& connections,
            RefusalRecorder* refusals)
      : gate_(gate), calls_(calls), connections_(connections), refusals_(refusals) {}
  // Whose all its connections are. Without it peers have certificates.
  void SetLocal(Peer peer) EXCLUDES(mutex_) {
    MutexLock lock(mutex_);
    local_ = std::move(peer);
  }
  bool IsBlocking() const override { return false; }  // no pool that Stop could wait for

  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext* context, OutputMetadata*,
                       OutputMetadata*) override {
    const auto found = metadata.find(":path");
    const std::string_view path = found == metadata.end() ? "" : View(found->second);
    const Peer peer = Introduce(*context);
    const Status admitted = Admit(path, peer, metadata);
    if (!admitted.ok() && refusals_ != nullptr) {
      refusals_->Record({RoleNamed(peer.role), peer.name, "connection " + peer.connection, ""},
                        path, admitted);
    }
    return wire::ToGrpc(admitted);
  }

 private:
  Status Admit(std::string_view path, const Peer& peer, const Metadata& metadata) {
    const auto caller = gate_.Admit(path, peer, TokensIn(metadata));
    if (!caller.ok() || Gate::IsStop(path)) return caller.status();
    return calls_.Room(CallBook::KeyOf(Name(caller->role), caller->name, caller->via));
  }
  // The first call of a connection writes, under the lock; later ones find it written.
  Peer Introduce(grpc::AuthContext& context) EXCLUDES(mutex_) {
    MutexLock lock(mutex_);
    if (!HasPeer(context)) {
      const std::string connection = std::to_string(++connections_);
      const auto pem = context.FindPropertyValues("x509_pem_cert");
      Peer peer = local_ ? *local_ : gate_.PeerOf(pem.empty() ? "" : View(pem[0]), connection);
      peer.connection = connection;
      WritePeer(peer, context);
    }
    return ReadPeer(context);
  }

  Gate& gate_;
  CallBook& calls_;
  std::atomic<uint64_t>& connections_;
  RefusalRecorder* const refusals_;
  Mutex mutex_;
  std::optional<Peer> local_ GUARDED_BY(mutex_);
};

// Connections that we accepted, on their way into gRPC.
struct Entrance {
  std::shared_ptr<Processor> processor;
  std::unique_ptr<Acceptor> acceptor;

  void Enter(const wire::Connection& connection) const {
    Acceptor::NewConnectionParameters parameters;
    parameters.listener_fd = connection.listener_fd;
    parameters.fd = connection.fd;
    acceptor->HandleNewConnection(&parameters);
  }
};

struct RoleSocket {
  Role role = Role::kNone;
  std::filesystem::path path;
  std::optional<gid_t> group;
};

class AccessImpl final : public Access {
 public:
  AccessImpl(AccessOptions options, std::string ca_pem)
      : options_(std::move(options)),
        allowed_(options_.tls_dir / kAllowedFile),
        gate_(options_.gate, options_.listen.empty() ? nullptr : &allowed_, std::move(ca_pem)),
        calls_(options_.calls, [this](const auto& context) { return StillWelcome(context); }),
        listeners_(options_.limits) {
    if (options_.audit != nullptr) refusals_.emplace(*options_.audit);
  }
  ~AccessImpl() override { Shutdown(std::chrono::system_clock::now()); }

  Status Start(PublishedEndpoint& endpoint, const std::vector<grpc::Service*>& services);
  void Shutdown(std::chrono::system_clock::time_point deadline) override;
  void Reload() override { allowed_.Reload(); }
  size_t calls_under_way() const override { return calls_.size(); }
  void SetServing(const std::string& service, bool serving) override {
    wire::SetServing(*server_, service, serving);
  }
  std::string address() const override { return address_; }

 private:
  Entrance MakeEntrance(grpc::ServerBuilder& builder,
                        const std::shared_ptr<grpc::ServerCredentials>& credentials);
  Status StillWelcome(const grpc::ServerContextBase& context);
  Status BuildServer(const std::vector<grpc::Service*>& services);
  Status ListenLocally(PublishedEndpoint& endpoint);
  Status ListenOnTheNetwork();
  void TakeLocal(const RoleSocket& socket, const wire::Connection& connection);

  const AccessOptions options_;
  AllowList allowed_;
  Gate gate_;
  std::atomic<uint64_t> connections_{0};
  std::optional<RefusalRecorder> refusals_;
  CallBook calls_;
  std::vector<Entrance> local_;                        // in use: the first local_callers_.size()
  std::vector<std::pair<Role, uid_t>> local_callers_;  // of the listeners' thread
  std::optional<Entrance> network_;
  RateLimit arrivals_{1, 20};  // lines logged; of the listeners' thread
  std::string address_;
  std::vector<std::filesystem::path> sockets_;  // removed at the end
  std::unique_ptr<grpc::Server> server_;
  wire::Listeners listeners_;  // ends before what it hands over to
};

Entrance AccessImpl::MakeEntrance(grpc::ServerBuilder& builder,
                                  const std::shared_ptr<grpc::ServerCredentials>& credentials) {
  using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  Entrance entrance;
  entrance.processor = std::make_shared<Processor>(gate_, calls_, connections_,
                                                   refusals_ ? &*refusals_ : nullptr);
  credentials->SetAuthMetadataProcessor(entrance.processor);
  entrance.acceptor =
      builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, credentials);
  return entrance;
}

std::shared_ptr<grpc::ServerCredentials> NetworkCredentials(const std::filesystem::path& dir) {
  namespace ge = grpc::experimental;
  auto files = std::make_shared<ge::FileWatcherCertificateProvider>(
      dir / kKeyFile, dir / kCertificateFile, dir / kCaFile, kRereadCertificate_s);
  ge::TlsServerCredentialsOptions options(files);
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  return ge::TlsServerCredentials(options);
}

Status AccessImpl::BuildServer(const std::vector<grpc::Service*>& services) {
  wire::PrepareGrpc();
  grpc::ServerBuilder builder;
  for (size_t i = 0; i < kLocalCallers; ++i) {
    local_.push_back(MakeEntrance(builder, grpc::experimental::LocalServerCredentials(UDS)));
  }
  if (!options_.listen.empty()) {
    network_ = MakeEntrance(builder, NetworkCredentials(options_.tls_dir));
  }
  builder.SetMaxReceiveMessageSize(kMaxRequestBytes);
  const auto set = [&](const char* name, int value) { builder.AddChannelArgument(name, value); };
  set(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, static_cast<int>(options_.handshake.count()));
  set(GRPC_ARG_MAX_CONCURRENT_STREAMS, 128);  // of one connection
  set(GRPC_ARG_KEEPALIVE_TIME_MS, 20'000);    // a peer that vanished is noticed
  set(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10'000);
  set(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  for (grpc::Service* service : services) builder.RegisterService(service);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(calls_.MakeWatches());
  if (options_.audit != nullptr) interceptors.push_back(MakeAuditInterceptors(*options_.audit));
  builder.experimental().SetInterceptorCreators(std::move(interceptors));
  server_ = builder.BuildAndStart();
  if (server_ == nullptr) return FailedPrecondition("gRPC starts no server");
  return OkStatus();
}

Status AccessImpl::ListenLocally(PublishedEndpoint& endpoint) {
  std::string published;
  for (const Role role : kSocketRoles) {
    RoleSocket socket{role,
                      endpoint.socket_path().replace_extension(fmt::format("{}.sock", Name(role))),
                      std::nullopt};
    mode_t mode = 0600;
    if (const auto group = options_.groups.find(role); group != options_.groups.end()) {
      MESORIG_ASSIGN_OR_RETURN(socket.group, wire::GroupNamed(group->second));
      mode = 0660;
    }
    MESORIG_RETURN_IF_ERROR(listeners_.AddUnix(
        socket.path, mode, socket.group,
        [this, socket](wire::Connection&& connection) { TakeLocal(socket, connection); }));
    sockets_.push_back(socket.path);
    published += fmt::format("{} unix:{}\n", Name(role), socket.path.string());
  }
  listeners_.Start();
  return endpoint.Publish(published);
}

Status AccessImpl::ListenOnTheNetwork() {
  if (!network_) return OkStatus();
  MESORIG_ASSIGN_OR_RETURN(
      address_, listeners_.AddTcp(options_.listen, [this](wire::Connection&& connection) {
        // Who opens one after the other is not told of each time.
        const std::string host = connection.from.substr(0, connection.from.rfind(':'));
        const auto now = std::chrono::steady_clock::now().time_since_epoch();
        if (arrivals_.Take(host, std::chrono::duration<double>(now).count())) {
          Log("access").info("connection from {}", connection.from);
        }
        network_->Enter(connection);
      }));
  return OkStatus();
}

Status AccessImpl::Start(PublishedEndpoint& endpoint, const std::vector<grpc::Service*>& services) {
  MESORIG_RETURN_IF_ERROR(BuildServer(services));
  MESORIG_RETURN_IF_ERROR(ListenOnTheNetwork());
  return ListenLocally(endpoint);
}

void AccessImpl::Shutdown(std::chrono::system_clock::time_point deadline) {
  listeners_.Stop();
  if (server_ == nullptr) return;
  std::error_code ignored;
  for (const auto& socket : sockets_) std::filesystem::remove(socket, ignored);
  server_->Shutdown(deadline);
  server_.reset();
}

// The file's mode and group let it through already; the peer's own uid and groups, as the kernel
// tells them, are what counts.
void AccessImpl::TakeLocal(const RoleSocket& socket, const wire::Connection& connection) {
  const wire::LocalPeer& peer = *connection.local;
  const auto refuse = [&](std::string_view why) {
    Log("access").warn("{} as {}: refused: {}", connection.from, Name(socket.role), why);
    ::close(connection.fd);
  };
  const bool member = socket.group && (peer.gid == *socket.group ||
                                       std::find(peer.groups.begin(), peer.groups.end(),
                                                 *socket.group) != peer.groups.end());
  if (peer.uid != ::geteuid() && peer.uid != 0 && !member) return refuse("not of its group");
  const std::pair who(socket.role, peer.uid);
  auto at = std::find(local_callers_.begin(), local_callers_.end(), who);
  if (at == local_callers_.end()) {
    if (local_callers_.size() == local_.size()) return refuse("too many users have come before");
    Peer caller;
    caller.role = Name(socket.role);
    caller.name = wire::UserName(peer.uid);
    local_[local_callers_.size()].processor->SetLocal(std::move(caller));
    at = local_callers_.insert(local_callers_.end(), who);
  }
  local_[static_cast<size_t>(at - local_callers_.begin())].Enter(connection);
}

Status AccessImpl::StillWelcome(const grpc::ServerContextBase& context) {
  const auto auth = context.auth_context();
  if (auth == nullptr || !HasPeer(*auth)) return OkStatus();
  return gate_.StillWelcome(ReadPeer(*auth), TokensIn(context.client_metadata()));
}

// What is wrong with the files is said here; gRPC would refuse every handshake without a word.
StatusOr<std::string> CheckTlsFiles(const std::filesystem::path& dir) {
  MESORIG_ASSIGN_OR_RETURN(const std::string ca, ReadFile(dir / kCaFile, 1 << 16));
  MESORIG_RETURN_IF_ERROR(ReadFile(dir / kKeyFile, 1 << 16).status());
  MESORIG_ASSIGN_OR_RETURN(const std::string pem, ReadFile(dir / kCertificateFile, 1 << 16));
  const auto identity = wire::ReadIdentityPem(pem);
  if (!identity.ok()) {
    return Annotate(identity.status(), (dir / kCertificateFile).string());
  }
  if (identity->role != "daemon") {
    return InvalidArgument("{}: its role is \"{}\", a daemon's is \"daemon\"",
                           (dir / kCertificateFile).string(), identity->role);
  }
  return ca;
}

}  // namespace

StatusOr<std::unique_ptr<Access>> Access::Create(AccessOptions options, PublishedEndpoint& endpoint,
                                                 const std::vector<grpc::Service*>& services) {
  std::string ca_pem;
  if (!options.listen.empty()) {
    MESORIG_ASSIGN_OR_RETURN(ca_pem, CheckTlsFiles(options.tls_dir));
  }
  auto access = std::make_unique<AccessImpl>(std::move(options), std::move(ca_pem));
  MESORIG_RETURN_IF_ERROR(access->Start(endpoint, services));
  return access;
}

}  // namespace mesorig::daemon
