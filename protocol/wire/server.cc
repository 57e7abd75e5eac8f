#include "protocol/wire/server.h"

#include <grpc/support/log.h>
#include <grpcpp/grpcpp.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>

#include "protocol/base/log.h"
#include "protocol/wire/grpc_alive.h"

namespace mesorig::wire {

namespace {

constexpr int kLinesPerSecond = 10;  // whoever makes handshakes fail makes lines

// On any thread.
void TakeLine(gpr_log_func_args* line) {
  static std::atomic<int64_t> second{0};
  static std::atomic<int> lines{0};
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  const int64_t this_second = std::chrono::duration_cast<std::chrono::seconds>(now).count();
  if (second.exchange(this_second) != this_second) lines = 0;
  if (++lines > kLinesPerSecond) return;
  Log("access").warn("gRPC: {}", line->message);
}

}  // namespace

void PrepareGrpc() {
  KeepGrpcAlive();
  gpr_set_log_function(TakeLine);
}

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
