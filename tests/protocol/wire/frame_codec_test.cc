#include "protocol/wire/frame_codec.h"

#include <gtest/gtest.h>

#include "protocol/wire/grpc_status.h"

namespace mesorig::wire {
namespace {

TEST(FrameCodec, IsAnOrdinaryProtobufMessage) {
  for (const size_t size : {size_t{0}, size_t{1}, size_t{127}, size_t{128}, size_t{98304}}) {
    v1::FrameHeader header;
    header.set_sequence(7);
    header.set_camera(3);
    header.add_axis_rad(0.5);
    header.set_digest("d");
    auto pixels = std::make_shared<std::string>(size, 'p');
    std::weak_ptr<std::string> watch = pixels;
    {
      const std::string_view view = *pixels;
      grpc::ByteBuffer buffer = EncodeFrame(header, view, std::move(pixels));
      EXPECT_FALSE(watch.expired()) << "the buffer must keep the pixels alive";
      std::vector<grpc::Slice> slices;
      ASSERT_TRUE(buffer.Dump(&slices).ok());
      std::string bytes;
      for (const auto& slice : slices) {
        bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
      }
      v1::Frame frame;
      ASSERT_TRUE(frame.ParseFromString(bytes));
      EXPECT_EQ(frame.header().sequence(), 7u);
      EXPECT_EQ(frame.header().axis_rad(0), 0.5);
      EXPECT_EQ(frame.pixels(), std::string(size, 'p'));
    }
    EXPECT_TRUE(watch.expired()) << "and let them go with itself";
  }
}

TEST(GrpcStatus, KeepsCodeAndMessage) {
  const Status status = InvalidArgument("lamp {}", 3);
  EXPECT_EQ(FromGrpc(ToGrpc(status)), status);
  EXPECT_TRUE(FromGrpc(ToGrpc(OkStatus())).ok());
}

}  // namespace
}  // namespace mesorig::wire
