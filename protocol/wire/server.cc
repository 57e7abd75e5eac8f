#include "protocol/wire/server.h"

#include <grpcpp/grpcpp.h>
#include <sys/stat.h>

#include "protocol/wire/grpc_alive.h"

namespace mesorig::wire {

void PrepareGrpc() { KeepGrpcAlive(); }

StatusOr<std::unique_ptr<grpc::Server>> StartServer(PublishedEndpoint& endpoint,
                                                    const std::vector<grpc::Service*>& services) {
  PrepareGrpc();
  const std::string address = "unix:" + endpoint.socket_path().string();
  grpc::ServerBuilder builder;
  int bound = 0;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials(), &bound);
  builder.SetMaxReceiveMessageSize(64 << 20);
  for (grpc::Service* service : services) builder.RegisterService(service);
  std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (server == nullptr) return FailedPrecondition("cannot listen on {}", address);
  ::chmod(endpoint.socket_path().c_str(), S_IRUSR | S_IWUSR);
  MESORIG_RETURN_IF_ERROR(endpoint.Publish(address));
  return server;
}

}  // namespace mesorig::wire
