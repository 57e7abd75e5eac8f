#include "processing/service/processing_server.h"

#include <grpcpp/grpcpp.h>

#include "processing/service/job_table.h"
#include "processing/service/session_job.h"
#include "protocol/base/log.h"
#include "protocol/base/program.h"
#include "protocol/messages/control.grpc.pb.h"
#include "protocol/messages/frames.grpc.pb.h"
#include "protocol/wire/channel.h"
#include "protocol/wire/grpc_status.h"
#include "protocol/wire/server.h"

namespace mesorig::service {
namespace {

constexpr auto kRetry = std::chrono::milliseconds(100);
constexpr double kAnswer_s = 10;

class Server final : public ProcessingServer {
 public:
  Server(const ServerOptions& options, PublishedEndpoint endpoint)
      : options_(options),
        endpoint_(std::move(endpoint)),
        table_(options.products_dir,
               [this](const std::string& session_id, std::function<void()> on_change) {
                 const JobOptions job{options_.runtime_dir, options_.products_dir,
                                      options_.patience_s};
                 return std::make_shared<SessionJob>(session_id, job, slots_, std::move(on_change));
               },
               [this](const std::string& session_id) { return AskStarts(session_id); }) {}
  ~Server() override {
    Stop();
    if (server_ != nullptr) {
      server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(1));
    }
  }

  Status Listen() {
    MESORIG_ASSIGN_OR_RETURN(server_, wire::StartServer(endpoint_, {&table_}));
    return OkStatus();
  }

  Status Run() override {
    MESORIG_RETURN_IF_ERROR(AwaitDaemon());
    bool away = false;
    while (!stop_.stopped()) {
      const Status status = Follow();
      if (stop_.stopped()) break;
      if (absl::IsFailedPrecondition(status)) return status;
      if (!away) Log("processing").warn("lost mesorigd ({}), waiting for it", Message(status));
      away = !status.ok();
      if (!stop_.SleepFor(kRetry)) break;
    }
    return OkStatus();
  }

  void Stop() override {
    stop_.Stop();
    table_.Stop();
  }

 private:
  StatusOr<std::unique_ptr<v1::Control::Stub>> Connect() {
    wire::Address daemon(options_.runtime_dir);
    daemon.role = wire::kProcessingRole;
    MESORIG_ASSIGN_OR_RETURN(auto channel,
                             wire::ConnectTo(daemon, wire::kDaemonName, 1));
    auto stub = v1::Control::NewStub(channel);
    Call call(stop_, kAnswer_s);
    v1::HelloRequest request;
    request.set_protocol_major(wire::kProtocolMajor);
    request.set_client(fmt::format("mesorig-processd {}", kVersion));
    v1::HelloReply reply;
    MESORIG_RETURN_IF_ERROR(wire::FromGrpc(stub->Hello(call.context(), request, &reply)));
    if (reply.protocol_major() != wire::kProtocolMajor) {
      return FailedPrecondition("{} speaks protocol {}, this is protocol {}", reply.server(),
                                reply.protocol_major(), wire::kProtocolMajor);
    }
    return stub;
  }

  std::optional<uint32_t> AskStarts(const std::string& session_id) {
    const auto channel = wire::ConnectTo(options_.runtime_dir, wire::kDaemonName, 1);
    if (!channel.ok()) return std::nullopt;
    Call call(stop_, kAnswer_s);
    v1::SessionRequest request;
    request.set_session_id(session_id);
    v1::SessionReply reply;
    const auto stub = v1::Frames::NewStub(*channel);
    if (!stub->GetSession(call.context(), request, &reply).ok()) return std::nullopt;
    return reply.starts();
  }

  Status AwaitDaemon() {
    const auto start = std::chrono::steady_clock::now();
    const auto limit = std::chrono::duration<double>(options_.connect_timeout_s);
    while (!stop_.stopped()) {
      const Status status = Connect().status();
      if (status.ok() || absl::IsFailedPrecondition(status)) return status;
      if (std::chrono::steady_clock::now() - start > limit) {
        return Annotate(status, fmt::format("waited {} s", options_.connect_timeout_s));
      }
      if (!stop_.SleepFor(kRetry)) break;
    }
    return OkStatus();
  }

  // The daemon's events until it goes away.
  Status Follow() {
    MESORIG_ASSIGN_OR_RETURN(const auto stub, Connect());
    {
      Call call(stop_, kAnswer_s);
      v1::StatusReply status;
      MESORIG_RETURN_IF_ERROR(wire::FromGrpc(stub->GetStatus(call.context(), {}, &status)));
      if (status.state() == v1::RUNNING) table_.Start(status.session_id());
    }
    Call call(stop_);
    const auto reader = stub->Watch(call.context(), v1::WatchRequest());
    v1::Event event;
    while (reader->Read(&event)) {
      // (A session that failed here and is resumed there begins again.)
      if (event.has_started()) table_.Start(event.started().session_id());
    }
    const Status end = wire::FromGrpc(reader->Finish());
    return end.ok() ? Unavailable("it closed the connection") : end;
  }

  const ServerOptions options_;
  PublishedEndpoint endpoint_;
  ComputeSlots slots_{kComputeThreads};
  JobTable table_;
  StopSignal stop_;
  std::unique_ptr<grpc::Server> server_;  // last: serves table_
};

}  // namespace

StatusOr<std::unique_ptr<ProcessingServer>> ProcessingServer::Start(const ServerOptions& options) {
  std::error_code error;
  std::filesystem::create_directories(options.products_dir, error);
  if (error) {
    return InvalidArgument("cannot create {}: {}", options.products_dir.string(), error.message());
  }
  MESORIG_ASSIGN_OR_RETURN(
      PublishedEndpoint endpoint,
      PublishedEndpoint::Claim(options.runtime_dir, wire::kProcessingName));
  auto server = std::make_unique<Server>(options, std::move(endpoint));
  MESORIG_RETURN_IF_ERROR(server->Listen());
  return server;
}

}  // namespace mesorig::service
