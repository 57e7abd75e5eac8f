#include "protocol/base/bytes.h"

#include <gtest/gtest.h>

#include "protocol/base/digest.h"

namespace mesorig {
namespace {

TEST(Bytes, LittleEndianRoundTrip) {
  const std::string bytes =
      ByteWriter().Put<uint16_t>(0x1234).Put(-2.5).PutString("abc").Put<int8_t>(-1).Take();
  EXPECT_EQ(bytes.substr(0, 2), "\x34\x12");
  ByteReader in(bytes);
  EXPECT_EQ(in.Get<uint16_t>(), 0x1234);
  EXPECT_EQ(in.Get<double>(), -2.5);
  EXPECT_EQ(in.GetString(), "abc");
  EXPECT_EQ(in.Get<int8_t>(), -1);
  EXPECT_TRUE(in.done());
}

TEST(Bytes, StaysFailedPastTheEnd) {
  ByteReader in("abc");
  EXPECT_EQ(in.Get<uint64_t>(), 0u);
  EXPECT_FALSE(in.ok());
  EXPECT_EQ(in.Get<uint8_t>(), 0u) << "nothing is read after a failure";
  EXPECT_EQ(in.remaining(), 0u);
}

TEST(Bytes, LengthsBeyondTheEndAreRefused) {
  const std::string bytes("\xff\xff\xff\xff", 4);  // the reader borrows
  ByteReader in(bytes);
  EXPECT_EQ(in.GetString(), "");
  EXPECT_FALSE(in.ok());
}

TEST(Digest, KnownVectors) {
  EXPECT_EQ(Sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(FrameDigest(""), "99aa06d3014798d86001c324468d497f");
}

}  // namespace
}  // namespace mesorig
