#pragma once
// Server ends: services on the socket that the program claimed in its runtime directory.

#include <memory>
#include <vector>

#include "protocol/base/runtime_dir.h"
#include "protocol/base/status.h"

namespace grpc {
class Server;
class Service;
}  // namespace grpc

namespace mesorig::wire {

// Before the first gRPC object of a process, on the main thread before there are others: keeps gRPC
// initialised, has it speak TLS 1.3 only, and takes its messages into our log.
void PrepareGrpc();

// Listens on `endpoint.socket_path()`, which only its owner may open, and publishes it. Services
// are borrowed for the server's life. The caller ends it with grpc::Server::Shutdown.
StatusOr<std::unique_ptr<grpc::Server>> StartServer(PublishedEndpoint& endpoint,
                                                    const std::vector<grpc::Service*>& services);

}  // namespace mesorig::wire
