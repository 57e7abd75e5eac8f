#pragma once
// Internal to daemon/service: what access.cc notes in a connection's grpc::AuthContext at its first
// call, and caller.cc reads. Written once, before any method sees a call of the connection: gRPC
// shares the context among a connection's calls and guards it by nothing.

#include <grpcpp/security/auth_context.h>

#include "daemon/service/gate.h"

namespace mesorig::daemon {

bool HasPeer(const grpc::AuthContext& context);
void WritePeer(const Peer& peer, grpc::AuthContext& context);
Peer ReadPeer(const grpc::AuthContext& context);  // empty role: none was written

}  // namespace mesorig::daemon
