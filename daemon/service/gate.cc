#include "daemon/service/gate.h"

#include <chrono>

#include "daemon/service/call_table.h"
#include "protocol/base/log.h"
#include "protocol/wire/identity.h"

namespace mesorig::daemon {
namespace {

constexpr std::string_view kGateway = "gateway";
constexpr std::string_view kStop = "Control/Stop";

template <typename... Args>
Status Unauthenticated(fmt::format_string<Args...> format, Args&&... args) {
  return absl::UnauthenticatedError(fmt::format(format, std::forward<Args>(args)...));
}

GateOptions WithClocks(GateOptions options) {
  if (!options.steady_s) {
    options.steady_s = [] {
      return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
          .count();
    };
  }
  if (!options.unix_s) {
    options.unix_s = [] { return static_cast<int64_t>(std::time(nullptr)); };
  }
  return options;
}

std::string Describe(const Caller& caller) {
  return caller.via.empty() ? caller.name : fmt::format("{} by {}", caller.name, caller.via);
}

}  // namespace

Gate::Gate(GateOptions options, AllowList* allowed, std::string ca_pem)
    : options_(WithClocks(std::move(options))),
      allowed_(allowed),
      verifier_(std::move(ca_pem)),
      calls_(options_.calls_per_s, options_.burst),
      refusals_(options_.refusals_per_s, options_.refusal_burst),
      tokens_(options_.unix_s()) {}

Peer Gate::PeerOf(std::string_view pem, std::string connection) const {
  Peer peer;
  peer.connection = std::move(connection);
  const auto identity = wire::ReadIdentityPem(pem);
  if (!identity.ok()) {
    peer.refusal = Message(identity.status());
    return peer;
  }
  peer.role = identity->role;
  peer.name = identity->name;
  peer.fingerprint = identity->fingerprint;
  peer.not_after_s = identity->not_after_s;
  if (identity->role != kGateway && RoleNamed(identity->role) == Role::kNone) {
    peer.refusal = fmt::format("the certificate of {}: role \"{}\" makes no calls", identity->name,
                               identity->role);
  } else if (identity->days() > options_.max_certificate_days) {
    peer.refusal =
        fmt::format("the certificate of {} is valid for {:.0f} days, at most {:.0f} are accepted",
                    identity->name, identity->days(), options_.max_certificate_days);
  }
  return peer;
}

Status Gate::CheckCertificate(const Peer& peer) const {
  if (peer.fingerprint.empty()) return OkStatus();
  if (peer.not_after_s <= options_.unix_s()) {
    return Unauthenticated("the certificate of {} has expired", peer.name);
  }
  if (allowed_ == nullptr || !allowed_->Allows(peer.fingerprint)) {
    return Unauthenticated(
        "the certificate of {} ({}) is not on the list of those allowed: "
        "revoked, or never entered",
        peer.name, peer.fingerprint);
  }
  return OkStatus();
}

StatusOr<Caller> Gate::Identify(const Peer& peer, const std::vector<std::string_view>& tokens) {
  if (!peer.refusal.empty()) return Unauthenticated("{}", peer.refusal);
  MESORIG_RETURN_IF_ERROR(CheckCertificate(peer));
  if (peer.role == kGateway) {
    if (tokens.size() == 1) return IdentifyByToken(peer, tokens[0]);
    return Unauthenticated("gateway {}: {} tokens; it calls for a user, with his one token",
                           peer.name, tokens.size());
  }
  if (!tokens.empty()) {
    return Unauthenticated("{} sends a token: only gateways forward them", peer.name);
  }
  Caller caller;
  caller.role = RoleNamed(peer.role);
  caller.name = peer.name;
  return caller;
}

StatusOr<Caller> Gate::IdentifyByToken(const Peer& gateway, std::string_view text) {
  const int64_t now_s = options_.unix_s();
  wire::Token token;
  bool known = false;
  {
    MutexLock lock(mutex_);
    if (const wire::Token* entered = tokens_.Known(text, gateway.connection)) {
      token = *entered;
      known = true;
    }
  }
  if (!known) {
    MESORIG_ASSIGN_OR_RETURN(token, verifier_.Verify(text, now_s));
  }
  if (token.expires_s <= now_s) return Unauthenticated("token of {}: expired", token.user.name);
  if (token.gateway != gateway.fingerprint) {
    return Unauthenticated("token of {}: it is for another gateway than {}", token.user.name,
                           gateway.name);
  }
  Peer user;
  user.role = token.user.role, user.name = token.user.name;
  user.fingerprint = token.user.fingerprint, user.not_after_s = token.user.not_after_s;
  MESORIG_RETURN_IF_ERROR(CheckCertificate(user));
  Caller caller;
  caller.role = RoleNamed(user.role);
  caller.name = user.name;
  caller.via = gateway.name;
  if (caller.role == Role::kNone || token.user.days() > options_.max_certificate_days) {
    return Unauthenticated(
        "token of {}: his certificate would not be accepted either: role \"{}\", "
        "valid for {:.0f} of at most {:.0f} days",
        user.name, user.role, token.user.days(), options_.max_certificate_days);
  }
  if (!known) {
    MutexLock lock(mutex_);
    // (Two calls at once may both have verified it.)
    if (tokens_.Known(text, gateway.connection) == nullptr) {
      MESORIG_RETURN_IF_ERROR(
          tokens_.Enter(std::move(token), text, gateway.connection, now_s).status());
    }
  }
  return caller;
}

StatusOr<Caller> Gate::Decide(std::string_view path, const Peer& peer,
                              const std::vector<std::string_view>& tokens) {
  MESORIG_ASSIGN_OR_RETURN(const Caller caller, Identify(peer, tokens));
  const CallRule* rule = FindRule(path);
  if (rule == nullptr) {
    return absl::PermissionDeniedError(
        fmt::format("{} is no call of mesorigd's table", path.substr(0, 100)));
  }
  if (caller.role < rule->least) {
    return absl::PermissionDeniedError(fmt::format("{} takes the role {}; {} has {}", rule->method,
                                                   Name(rule->least), Describe(caller),
                                                   Name(caller.role)));
  }
  return caller;
}

StatusOr<Caller> Gate::Admit(std::string_view path, const Peer& peer,
                             const std::vector<std::string_view>& tokens) {
  const double now_s = options_.steady_s();
  auto caller = Decide(path, peer, tokens);
  if (!caller.ok()) {
    Tell(path, peer, caller.status(), now_s);
    return caller;
  }
  if (IsStop(path)) return caller;
  MutexLock lock(mutex_);
  if (calls_.Take(fmt::format("{} {} {}", Name(caller->role), caller->name, caller->via), now_s)) {
    return caller;
  }
  return absl::ResourceExhaustedError(
      fmt::format("{}: more than {:.0f} calls a second", Describe(*caller), options_.calls_per_s));
}

bool Gate::IsStop(std::string_view path) {
  const CallRule* rule = FindRule(path);
  return rule != nullptr && rule->method == kStop;
}

void Gate::Tell(std::string_view path, const Peer& peer, const Status& why, double now_s) {
  {
    MutexLock lock(mutex_);
    if (!refusals_.Take(peer.connection, now_s)) return;
  }
  Log("access").warn("{} over connection {} refused: {}", path.substr(0, 100), peer.connection,
                     Message(why));
  if (options_.on_refused) options_.on_refused(path, peer, why);
}

Status Gate::StillWelcome(const Peer& peer, const std::vector<std::string_view>& tokens) {
  return Identify(peer, tokens).status();
}

}  // namespace mesorig::daemon
