#include "daemon/service/caller.h"

#include <grpcpp/server_context.h>

#include <array>
#include <charconv>

#include "daemon/service/auth_properties.h"
#include "protocol/wire/token.h"

namespace mesorig::daemon {
namespace {

constexpr std::array<std::string_view, kRoles> kNames = {"none", "observer", "processing",
                                                         "operator", "administrator"};

constexpr char kConnection[] = "mesorig-connection", kRole[] = "mesorig-role",
               kName[] = "mesorig-name", kFingerprint[] = "mesorig-fingerprint",
               kUntil[] = "mesorig-until", kRefusal[] = "mesorig-refusal";

std::string Property(const grpc::AuthContext& context, const char* name) {
  const auto values = context.FindPropertyValues(name);
  return values.empty() ? "" : std::string(values[0].data(), values[0].size());
}

}  // namespace

std::string_view Name(Role role) { return kNames[static_cast<size_t>(role)]; }

Role RoleNamed(std::string_view name) {
  for (size_t i = 1; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<Role>(i);
  }
  return Role::kNone;
}

bool HasPeer(const grpc::AuthContext& context) {
  return !context.FindPropertyValues(kConnection).empty();
}

void WritePeer(const Peer& peer, grpc::AuthContext& context) {
  context.AddProperty(kConnection, peer.connection);
  context.AddProperty(kRole, peer.role);
  context.AddProperty(kName, peer.name);
  context.AddProperty(kFingerprint, peer.fingerprint);
  context.AddProperty(kUntil, std::to_string(peer.not_after_s));
  context.AddProperty(kRefusal, peer.refusal);
}

Peer ReadPeer(const grpc::AuthContext& context) {
  Peer peer;
  peer.connection = Property(context, kConnection);
  peer.role = Property(context, kRole);
  peer.name = Property(context, kName);
  peer.fingerprint = Property(context, kFingerprint);
  const std::string until = Property(context, kUntil);
  std::from_chars(until.data(), until.data() + until.size(), peer.not_after_s);
  peer.refusal = Property(context, kRefusal);
  return peer;
}

Caller CallerOf(const grpc::ServerContextBase& context) {
  Caller caller;
  const auto auth = context.auth_context();
  if (auth == nullptr || !HasPeer(*auth)) return caller;
  const Peer peer = ReadPeer(*auth);
  caller.peer = context.peer();
  if (caller.peer.starts_with("unix:")) caller.peer = "unix";
  caller.role = RoleNamed(peer.role);
  caller.name = peer.name;
  if (caller.role != Role::kNone) return caller;
  // A gateway's call was let in by the user's token, which was verified then.
  const auto& metadata = context.client_metadata();
  const auto sent = metadata.find(wire::kTokenKey);
  if (sent == metadata.end()) return Caller();
  const auto token = wire::ParseToken({sent->second.data(), sent->second.size()});
  if (!token.ok()) return Caller();
  caller.via = peer.name;
  caller.name = token->user.name;
  caller.role = RoleNamed(token->user.role);
  return caller;
}

}  // namespace mesorig::daemon
