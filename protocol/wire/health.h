#pragma once
// The health service of gRPC (grpc.health.v1), of the daemon.

#include <string>

namespace grpc {
class Server;
}

namespace mesorig::wire {

// Every server that is built from now on has it.
void EnableHealth();
// What a Check or Watch of `service` is told; "" is the server as a whole. Any thread.
void SetServing(grpc::Server& server, const std::string& service, bool serving);

}  // namespace mesorig::wire
