#include "protocol/wire/channel.h"

#include <grpcpp/grpcpp.h>

#include "protocol/base/runtime_dir.h"
#include "protocol/wire/grpc_alive.h"

namespace mesorig::wire {

std::shared_ptr<grpc::Channel> MakeChannel(std::string_view endpoint) {
  KeepGrpcAlive();
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(256 << 20);
  arguments.SetInt("grpc.use_local_subchannel_pool", 1);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 500);
  return grpc::CreateCustomChannel(std::string(endpoint), grpc::InsecureChannelCredentials(),
                                   arguments);
}

StatusOr<std::shared_ptr<grpc::Channel>> ConnectTo(const std::filesystem::path& runtime_dir,
                                                   std::string_view name, double timeout_s) {
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint, FindEndpoint(runtime_dir, name));
  auto channel = MakeChannel(endpoint);
  const auto deadline = std::chrono::system_clock::now() +
                        std::chrono::milliseconds(static_cast<int64_t>(timeout_s * 1000));
  if (!channel->WaitForConnected(deadline)) {
    return Unavailable("{} does not answer at {}", name, endpoint);
  }
  return channel;
}

}  // namespace mesorig::wire
