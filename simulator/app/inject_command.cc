#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "protocol/base/bytes.h"
#include "protocol/base/runtime_dir.h"
#include "protocol/sim_wire/envelope.h"
#include "protocol/sim_wire/unix_socket.h"
#include "simulator/app/commands.h"
#include "simulator/devices/faults/fault_table.h"

namespace mesorig::simulator {
namespace {

constexpr int kTimeoutMs = 10000;

struct InjectOptions {
  std::string runtime_dir = DefaultRuntimeDir().string();
  std::vector<std::string> words;
};

// What the words stand for: one injection each. `operator remount MOUNT` is the operator's part of
// a remount, from opening the door to the reset.
StatusOr<std::vector<std::string>> Injections(const std::vector<std::string>& words) {
  const std::string text = fmt::format("{}", fmt::join(words, " "));
  constexpr std::string_view kOperator = "operator ", kRemount = "operator remount ";
  if (!text.starts_with(kOperator)) return std::vector{text};
  if (!text.starts_with(kRemount) || text.size() == kRemount.size()) {
    return InvalidArgument("\"{}\": the operator knows only: remount MOUNT", text);
  }
  return std::vector<std::string>{"lines door open",
                                  fmt::format("nxt mount {}", text.substr(kRemount.size())),
                                  "lines door close", "lines reset"};
}

// Waits for the answer to injection `id`.
Status ReadAnswer(const sim_wire::Fd& fd, sim_wire::MessageReader& reader, uint32_t id) {
  char buffer[4096];
  for (;;) {
    while (const auto message = reader.Next()) {
      if (message->type != sim_wire::MessageType::kReply || message->payload.empty()) continue;
      if (message->id != id && message->id != 0) continue;
      if (message->payload[0] == static_cast<char>(sim_wire::Answer::kOk)) return OkStatus();
      return InvalidArgument("{}", std::string_view(message->payload).substr(1));
    }
    MESORIG_ASSIGN_OR_RETURN(const size_t size,
                             sim_wire::ReceiveSome(fd.get(), buffer, sizeof(buffer)));
    if (size == 0) return Unavailable("the simulator closed the connection");
    MESORIG_RETURN_IF_ERROR(reader.Feed({buffer, size}));
  }
}

Status Inject(const InjectOptions& options) {
  using sim_wire::MessageType;
  MESORIG_ASSIGN_OR_RETURN(const auto injections, Injections(options.words));
  MESORIG_ASSIGN_OR_RETURN(const std::string endpoint,
                           FindEndpoint(options.runtime_dir, "mesorig-sim"));
  MESORIG_ASSIGN_OR_RETURN(const sim_wire::Fd fd,
                           sim_wire::Connect(endpoint.substr(std::string("unix:").size())));
  const auto role = static_cast<uint8_t>(sim_wire::Role::kInjector);
  std::string bytes;
  sim_wire::AppendMessage({MessageType::kHello,
                           0,
                           0,
                           {},
                           ByteWriter().Put(sim_wire::kProtocolVersion).Put(role).Take()},
                          bytes);
  MESORIG_RETURN_IF_ERROR(sim_wire::SendAll(fd.get(), bytes, kTimeoutMs));
  sim_wire::MessageReader reader;
  Status first;  // after an error the door is still closed behind it
  for (uint32_t id = 1; id <= injections.size(); ++id) {
    if (!first.ok() && injections[id - 1] != "lines door close") continue;
    bytes.clear();
    sim_wire::AppendMessage({MessageType::kInject, 0, id, {}, injections[id - 1]}, bytes);
    MESORIG_RETURN_IF_ERROR(sim_wire::SendAll(fd.get(), bytes, kTimeoutMs));
    const Status status = ReadAnswer(fd, reader, id);
    if (first.ok()) first = status;
  }
  return first;
}

}  // namespace

Command AddInjectCommand(CLI::App& app) {
  auto options = std::make_shared<InjectOptions>();
  CLI::App* inject = app.add_subcommand(
      "inject", "A fault, or a hand at the rig: DEVICE FAULT..., one of those listed below");
  inject->footer(
      "Devices: can, lamps, nxt, lines, camera:SERIAL, rig (the simulated rig as a whole).\n"
      "N is 1 unless told; a silent camera is so until it is replugged.\n\n" +
      FaultHelp("  ") + fmt::format("  {:<40} {}\n", "operator remount MOUNT",
                                    "door open, mount, door close, reset"));
  inject->add_option("words", options->words, "DEVICE FAULT")->required();
  inject->add_option("--runtime-dir", options->runtime_dir, "Where programs find each other")
      ->capture_default_str();
  return {inject, [options] { return Inject(*options); }};
}

}  // namespace mesorig::simulator
