#include "protocol/sim_wire/envelope.h"

#include <gtest/gtest.h>

#include <random>

#include "protocol/sim_wire/payloads.h"

namespace mesorig::sim_wire {
namespace {

TEST(Envelope, ArrivesInAnyPieces) {
  std::string stream;
  for (int i = 0; i < 20; ++i) {
    AppendMessage({MessageType::kOutput, static_cast<uint16_t>(i), 7u * i, RigTime(i * 1000),
                   std::string(static_cast<size_t>(i * 13), 'x')},
                  stream);
  }
  for (const size_t piece : {size_t{1}, size_t{5}, size_t{64}, stream.size()}) {
    MessageReader reader;
    int seen = 0;
    for (size_t at = 0; at < stream.size(); at += piece) {
      ASSERT_TRUE(reader.Feed(std::string_view(stream).substr(at, piece)).ok());
      while (const auto message = reader.Next()) {
        EXPECT_EQ(message->device, seen);
        EXPECT_EQ(message->id, 7u * seen);
        EXPECT_EQ(message->time, RigTime(seen * 1000));
        EXPECT_EQ(message->payload.size(), static_cast<size_t>(seen * 13));
        ++seen;
      }
    }
    EXPECT_EQ(seen, 20);
  }
}

TEST(Envelope, RefusesAbsurdLengthsBeforeAllocating) {
  MessageReader reader;
  EXPECT_FALSE(reader.Feed(std::string("\xff\xff\xff\xff rest", 9)).ok());
  MessageReader short_one;
  EXPECT_FALSE(short_one.Feed(std::string("\x01\0\0\0\x01", 5)).ok());
}

TEST(Payloads, RoundTrip) {
  const CanFrame can{0x185, 3, {1, 2, 3}};
  EXPECT_EQ(UnpackCanFrame(Pack(can)).value(), can);
  EXPECT_EQ(UnpackLineEdge(Pack(LineEdge{4, 1})).value().line, 4);
  EXPECT_EQ(UnpackRegisterValue(PackRegisterValue(0.02)).value(), 0.02);
  CameraFrame frame{3, 9, RigTime(10), RigTime(20), 4, 2, 12, std::string(16, 'p')};
  const auto read = UnpackCameraFrame(Pack(frame));
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(read->pixels, frame.pixels);
  EXPECT_EQ(read->frame_id, 9u);
  frame.pixels.pop_back();
  EXPECT_TRUE(absl::IsDataLoss(UnpackCameraFrame(Pack(frame)).status())) << "torn";
  frame.pixels.resize(17);
  EXPECT_TRUE(absl::IsInvalidArgument(UnpackCameraFrame(Pack(frame)).status()));
  EXPECT_TRUE(UnpackCameraAccess(Pack(CameraAccess{CameraRegister::kDeviceTime_s, false, 0})).ok());
}

TEST(Payloads, DamagedFramesAreKnownByTheirChecksum) {
  const std::string whole = Pack(CameraFrame{3, 9, RigTime(10), RigTime(20), 4, 2, 12,
                                             std::string(16, 'p')});
  for (size_t i = 0; i < whole.size(); ++i) {
    std::string damaged = whole;
    damaged[i] ^= 0x20;
    EXPECT_FALSE(UnpackCameraFrame(damaged).ok()) << "byte " << i;
  }
}

// Mutated and truncated bytes are refused or read as something valid; they never crash.
TEST(Payloads, SurviveMutation) {
  std::mt19937 random(1);
  Welcome welcome{"sha", 3, RigTime(5), {"can", "lines"}, "127.0.0.1:1"};
  std::string stream;
  AppendMessage({MessageType::kWelcome, 0, 0, {}, Pack(welcome)}, stream);
  const std::vector<std::string> seeds = {
      Pack(welcome), Pack(CanFrame{1, 8, {}}), Pack(LineEdge{1, 1}), Pack(CameraTrigger{1}),
      Pack(CameraFrame{1, 1, {}, {}, 2, 2, 8, "abcd"}), Pack(CameraFrame{1, 1, {}, {}, 2, 2, 8, "ab"}),
      Pack(CameraAccess{CameraRegister::kDeviceTime_s, false, 1}), PackRegisterValue(3), stream};
  int refused = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string bytes = seeds[random() % seeds.size()];
    bytes[random() % bytes.size()] = static_cast<char>(random());
    if (random() % 2 != 0) bytes.resize(random() % bytes.size());
    refused += !UnpackWelcome(bytes).ok();
    (void)UnpackCanFrame(bytes).ok();
    (void)UnpackLineEdge(bytes).ok();
    (void)UnpackCameraAccess(bytes).ok();
    (void)UnpackCameraTrigger(bytes).ok();
    (void)UnpackCameraFrame(bytes).ok();
    (void)UnpackRegisterValue(bytes).ok();
    (void)UnpackLineQuery(bytes).ok();
    MessageReader reader;
    (void)reader.Feed(bytes).ok();
    while (reader.Next()) {
    }
  }
  EXPECT_GT(refused, 10000);
}

}  // namespace
}  // namespace mesorig::sim_wire
