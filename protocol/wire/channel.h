#pragma once
// Client ends. Include the generated *.grpc.pb.h beside this in the .cc that calls a service.

#include <filesystem>
#include <memory>
#include <string_view>

#include "protocol/base/status.h"

namespace grpc {
class Channel;
}

namespace mesorig::wire {

// Names under which the services publish their endpoints.
inline constexpr std::string_view kDaemonName = "mesorigd";
inline constexpr std::string_view kProcessingName = "mesorig-processd";
inline constexpr std::string_view kSimulatorName = "mesorig-sim";

inline constexpr uint32_t kProtocolMajor = 1;

// A connection of its own to `endpoint` ("unix:PATH" or "HOST:PORT"): one HTTP/2 connection is one
// core, so frames take a channel per camera. Messages up to 256 MiB. Connects on first use.
std::shared_ptr<grpc::Channel> MakeChannel(std::string_view endpoint);

// Finds `name` in the runtime directory and waits until it answers, at most `timeout_s`.
// Unavailable: "mesorigd is not running (...)" or "... does not answer".
StatusOr<std::shared_ptr<grpc::Channel>> ConnectTo(const std::filesystem::path& runtime_dir,
                                                   std::string_view name, double timeout_s = 5);

}  // namespace mesorig::wire
