#pragma once
// Calls by path, whatever the message: for tests of who may call at all.

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/method_handler.h>

#include <atomic>
#include <list>
#include <map>
#include <string>

#include "daemon/service/call_table.h"
#include "daemon/service/caller.h"

namespace mesorig::daemon {

inline std::string PathOf(const CallRule& rule) {
  const bool whole = rule.method.starts_with("/");
  return (whole ? "" : "/mesorig.v1.") + std::string(rule.method);
}

struct AnyReply {
  grpc::Status status;
  std::string text;
};

inline std::atomic<int> any_calls{0};  // made by this process

// One unary call with an empty request.
inline AnyReply AnyCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& path,
                        const std::multimap<std::string, std::string>& metadata = {},
                        const std::string& request = "") {
  ++any_calls;
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  for (const auto& [key, value] : metadata) context.AddMetadata(key, value);
  const grpc::Slice slice(request);
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareUnaryCall(&context, path, grpc::ByteBuffer(&slice, 1), &queue);
  call->StartCall();
  AnyReply reply;
  grpc::ByteBuffer bytes;
  call->Finish(&bytes, &reply.status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  grpc::Slice whole;
  if (reply.status.ok() && bytes.DumpToSingleSlice(&whole).ok()) {
    reply.text.assign(reinterpret_cast<const char*>(whole.begin()), whole.size());
  }
  return reply;
}

// Answers every call of CallTable() with who called: "operator anna via console".
class WhoAmI final : public grpc::Service {
 public:
  WhoAmI() {
    for (const CallRule& rule : CallTable()) {
      paths_.push_back(PathOf(rule));
      using Bytes = grpc::ByteBuffer;
      using Handler = grpc::internal::RpcMethodHandler<WhoAmI, Bytes, Bytes, Bytes, Bytes>;
      AddMethod(new grpc::internal::RpcServiceMethod(
          paths_.back().c_str(), grpc::internal::RpcMethod::NORMAL_RPC,
          new Handler([](WhoAmI*, grpc::ServerContext* context, const grpc::ByteBuffer*,
                         grpc::ByteBuffer* reply) { return Answer(*context, *reply); },
                      this)));
    }
  }

 private:
  static grpc::Status Answer(const grpc::ServerContext& context, grpc::ByteBuffer& reply) {
    const Caller caller = CallerOf(context);
    std::string text = std::string(Name(caller.role)) + " " + caller.name;
    if (!caller.via.empty()) text += " via " + caller.via;
    const grpc::Slice slice(text);
    reply = grpc::ByteBuffer(&slice, 1);
    return grpc::Status::OK;
  }
  std::list<std::string> paths_;  // borrowed by the methods
};

}  // namespace mesorig::daemon
