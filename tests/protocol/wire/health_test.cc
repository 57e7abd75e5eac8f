#include "protocol/wire/health.h"

#include <gtest/gtest.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include "protocol/messages/control.grpc.pb.h"
#include "protocol/wire/channel.h"

namespace mesorig::wire {
namespace {

constexpr char kServing = 1, kNotServing = 2;

// grpc.health.v1.Health/Check, byte by byte: field 1 of the request is the service's name, field 1
// of the reply the status. -1: the call failed.
int Check(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
  std::string request;
  if (!service.empty()) {
    request = "\x0a";
    request += static_cast<char>(service.size());
    request += service;
  }
  const grpc::Slice slice(request);
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  grpc::CompletionQueue queue;
  const auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check",
                                          grpc::ByteBuffer(&slice, 1), &queue);
  call->StartCall();
  grpc::ByteBuffer bytes;
  grpc::Status status;
  call->Finish(&bytes, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  grpc::Slice whole;
  if (!status.ok() || !bytes.DumpToSingleSlice(&whole).ok() || whole.size() != 2) return -1;
  return whole.begin()[1];
}

TEST(Health, TellsOfEachService) {
  EnableHealth();
  v1::Control::Service control;
  const std::string address = fmt::format("unix:/tmp/mesorig-health-{}", ::getpid());
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials());
  builder.RegisterService(&control);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  ASSERT_NE(server, nullptr);
  const auto channel = grpc::CreateChannel(address, grpc::InsecureChannelCredentials());
  SetServing(*server, "mesorig.v1.Control", true);
  EXPECT_EQ(Check(channel, "mesorig.v1.Control"), kServing);
  EXPECT_EQ(Check(channel, ""), kServing);
  SetServing(*server, "mesorig.v1.Control", false);
  EXPECT_EQ(Check(channel, "mesorig.v1.Control"), kNotServing);
  EXPECT_EQ(Check(channel, "mesorig.v1.Coffee"), -1) << "NOT_FOUND";
}

}  // namespace
}  // namespace mesorig::wire
