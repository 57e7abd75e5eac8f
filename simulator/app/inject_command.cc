#include <CLI/CLI.hpp>
#include <fmt/ranges.h>

#include <memory>

#include "protocol/base/bytes.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/unix_socket.h"
#include "simulator/app/commands.h"

namespace mesorig::simulator {
namespace {

constexpr int kTimeoutMs = 10000;

struct InjectOptions {
  std::string runtime_dir = DefaultRuntimeDir().string();
  std::vector<std::string> words;
};

Status Inject(const InjectOptions& options) {
  using sim_wire::MessageType;
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint,
                           FindEndpoint(options.runtime_dir, "mesorig-sim"));
  MESORIG_ASSIGN_OR_RETURN(const sim_wire::Fd fd,
                           sim_wire::Connect(endpoint.substr(std::string("unix:").size())));
  const auto role = static_cast<uint8_t>(sim_wire::Role::kInjector);
  std::string bytes;
  sim_wire::AppendMessage({MessageType::kHello, 0, 0, {},
                           ByteWriter().Put(sim_wire::kProtocolVersion).Put(role).Take()},
                          bytes);
  sim_wire::AppendMessage(
      {MessageType::kInject, 0, 1, {}, fmt::format("{}", fmt::join(options.words, " "))}, bytes);
  MESORIG_RETURN_IF_ERROR(sim_wire::SendAll(fd.get(), bytes, kTimeoutMs));
  sim_wire::MessageReader reader;
  char buffer[4096];
  for (;;) {
    while (const auto message = reader.Next()) {
      if (message->type != MessageType::kReply || message->payload.empty()) continue;
      if (message->payload[0] != 0) return OkStatus();
      return InvalidArgument("{}", std::string_view(message->payload).substr(1));
    }
    MESORIG_ASSIGN_OR_RETURN(const size_t size,
                             sim_wire::ReceiveSome(fd.get(), buffer, sizeof(buffer)));
    if (size == 0) return Unavailable("the simulator closed the connection");
    MESORIG_RETURN_IF_ERROR(reader.Feed({buffer, size}));
  }
}

}  // namespace

Command AddInjectCommand(CLI::App& app) {
  auto options = std::make_shared<InjectOptions>();
  CLI::App* inject = app.add_subcommand(
      "inject", "A hand at the rig: lines estop open|close, lines door open|close, lines reset");
  inject->add_option("words", options->words, "DEVICE FAULT")->required();
  inject->add_option("--runtime-dir", options->runtime_dir, "Where programs find each other")
      ->capture_default_str();
  return {inject, [options] { return Inject(*options); }};
}

}  // namespace mesorig::simulator
