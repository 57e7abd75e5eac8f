#pragma once
// Requests to services behind a real gRPC server in this process. The input is text: requests apart
// by a line `--`, each the method's full name in one line (`mesorig.v1.Frames/Subscribe`) and the
// request in protobuf's text format; what is no text of that message goes out as it stands, as
// bytes from a peer that speaks something else. New methods need no line here.

#include <google/protobuf/descriptor.h>
#include <google/protobuf/dynamic_message.h>
#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/text_format.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tests/fuzz/fuzz_target.h"

namespace mesorig::fuzz {

// Borrows the services.
class RequestRunner {
 public:
  explicit RequestRunner(const std::vector<grpc::Service*>& services) {
    grpc::ServerBuilder builder;
    for (grpc::Service* service : services) builder.RegisterService(service);
    server_ = builder.BuildAndStart();
    MESORIG_CHECK(server_ != nullptr);
    stub_ = std::make_unique<grpc::GenericStub>(server_->InProcessChannel({}));
  }

  void Run(std::string_view text) {
    for (int i = 0; i < kMaxRequests && !text.empty(); ++i) Send(TakeUntil(text, "\n--\n"));
  }

 private:
  static constexpr int kMaxRequests = 8, kMaxReplies = 20;

  // Silent: what is no text format is part of the game.
  class Silence final : public google::protobuf::io::ErrorCollector {
    void AddError(int, int, const std::string&) override {}
  };

  static std::string Serialized(const google::protobuf::MethodDescriptor& method,
                                std::string_view text) {
    static google::protobuf::DynamicMessageFactory factory;
    const std::unique_ptr<google::protobuf::Message> message(
        factory.GetPrototype(method.input_type())->New());
    Silence silence;
    google::protobuf::TextFormat::Parser parser;
    parser.RecordErrorsTo(&silence);
    parser.SetRecursionLimit(20);
    if (!parser.ParseFromString(std::string(text), message.get())) return std::string(text);
    return message->SerializeAsString();
  }

  void Send(std::string_view request) {
    std::string name(TakeUntil(request, "\n"));
    const size_t slash = name.find('/');
    if (slash == name.npos) return;
    const auto* service = google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(
        name.substr(0, slash));
    const auto* method = service ? service->FindMethodByName(name.substr(slash + 1)) : nullptr;
    if (method == nullptr) return;
    const grpc::Slice slice(Serialized(*method, request));
    grpc::ClientContext context;
    // A stream of what goes on ends with its deadline; a single answer that does not come hangs.
    const bool streams = method->server_streaming();
    context.set_deadline(std::chrono::system_clock::now() +
                         std::chrono::milliseconds(streams ? 100 : 30'000));
    const grpc::Status status = Call(context, "/" + name, grpc::ByteBuffer(&slice, 1));
    MESORIG_CHECK(streams || status.error_code() != grpc::StatusCode::DEADLINE_EXCEEDED);
  }

  // A stream of replies is read for a while, then left.
  grpc::Status Call(grpc::ClientContext& context, const std::string& method,
                    const grpc::ByteBuffer& request) {
    grpc::CompletionQueue queue;
    const auto call = stub_->PrepareCall(&context, method, &queue);
    const auto done = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    call->StartCall(nullptr);
    bool going = done();
    if (going) {
      call->WriteLast(request, {}, nullptr);
      going = done();
    }
    grpc::ByteBuffer reply;
    for (int i = 0; going && i < kMaxReplies; ++i) {
      call->Read(&reply, nullptr);
      going = done();
    }
    if (going) context.TryCancel();
    grpc::Status status;
    call->Finish(&status, nullptr);
    done();
    return status;
  }

  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<grpc::GenericStub> stub_;
};

}  // namespace mesorig::fuzz
