// Any message of any call, from somebody who may call it: sound or not, all are answered.

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/dynamic_message.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "daemon/service/call_table.h"
#include "tests/daemon/service/any_call.h"
#include "tests/daemon/service/by_hand_fixture.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

class HostileRequestsTest : public ByHandTest {
 protected:
  HostileRequestsTest() {
    access_options_.gate.calls_per_s = 1e6;  // its tests are elsewhere
  }
};

// Any message of a call, with fields that make some sense or none.
void FillAtRandom(google::protobuf::Message& message, uint64_t token, std::mt19937_64& random) {
  using Field = google::protobuf::FieldDescriptor;
  const double numbers[] = {0, 0.5, -1, 1e308, 5e-324, NAN, INFINITY, -INFINITY};
  const char* texts[] = {"turntable", "light_arc", "L0", "L1", "", "..", "\x7f\x01", "a/b"};
  const uint64_t integers[] = {token, token + 1, 0, 1, UINT64_MAX};
  const auto& reflection = *message.GetReflection();
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const Field* field = message.GetDescriptor()->field(i);
    if (random() % 8 == 0 || field->is_repeated()) continue;
    const uint64_t integer = integers[random() % std::size(integers)];
    switch (field->cpp_type()) {
      case Field::CPPTYPE_DOUBLE:
        reflection.SetDouble(&message, field, numbers[random() % std::size(numbers)]);
        break;
      case Field::CPPTYPE_STRING:
        reflection.SetString(&message, field, texts[random() % std::size(texts)]);
        break;
      case Field::CPPTYPE_UINT64:
        reflection.SetUInt64(&message, field, integer);
        break;
      case Field::CPPTYPE_UINT32:
        reflection.SetUInt32(&message, field, static_cast<uint32_t>(integer));
        break;
      case Field::CPPTYPE_INT32:
        reflection.SetInt32(&message, field, static_cast<int32_t>(integer));
        break;
      case Field::CPPTYPE_BOOL:
        reflection.SetBool(&message, field, integer == 1);
        break;
      default:  // (no request has another kind)
        ADD_FAILURE() << field->full_name();
    }
  }
}

TEST_F(HostileRequestsTest, AreAnsweredAndMoveNothingUnsound) {
  google::protobuf::DynamicMessageFactory messages;
  std::mt19937_64 random(17);
  int calls = 0, accepted = 0;
  for (const CallRule& rule : CallTable()) {
    if (rule.method.starts_with("/")) continue;  // the health service, which is gRPC's
    std::string name = PathOf(rule).substr(1);
    name[name.find('/')] = '.';
    const auto* method = google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(name);
    ASSERT_NE(method, nullptr) << name;
    if (method->server_streaming()) continue;  // some never end: tests/fuzz
    for (int i = 0; i < 12; ++i) {
      const uint64_t token = Take(true).token();
      const std::unique_ptr<google::protobuf::Message> request(
          messages.GetPrototype(method->input_type())->New());
      FillAtRandom(*request, token, random);
      std::string bytes = request->SerializePartialAsString();
      if (i % 3 == 2 && !bytes.empty())
        bytes[random() % bytes.size()] ^= static_cast<char>(random());
      const AnyReply reply = AnyCall(channel_, PathOf(rule), {}, bytes);
      ++calls;
      accepted += reply.status.ok();
      const auto code = reply.status.error_code();
      const bool away = code == grpc::StatusCode::UNAVAILABLE && method->name() != "Diagnose";
      ASSERT_TRUE(!away && code != grpc::StatusCode::UNKNOWN &&
                  code != grpc::StatusCode::DEADLINE_EXCEEDED)
          << name << ": " << reply.status.error_message() << '\n'
          << request->DebugString();
    }
  }
  EXPECT_GT(calls, 200);
  EXPECT_GT(accepted, calls / 10);
  EXPECT_FALSE(hand_.said().empty()) << "nothing got through: the test means nothing";
  for (const std::string& said : hand_.said()) {
    EXPECT_THAT(said, ::testing::Not(::testing::AnyOf(HasSubstr("nan"), HasSubstr("inf")))) << said;
  }
}

}  // namespace
}  // namespace mesorig::daemon
