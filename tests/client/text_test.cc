#include "client/cli/text.h"

#include <gtest/gtest.h>

namespace mesorig::client {
namespace {

TEST(Text, Units) {
  EXPECT_EQ(BytesText(98304), "98.3 kB");
  EXPECT_EQ(BytesText(226492416), "226.5 MB");
  EXPECT_EQ(DurationText(2.26), "2.3 s");
  EXPECT_EQ(DurationText(200), "3 min 20 s");
  EXPECT_EQ(DurationText(7260), "2 h 1 min");
}

TEST(Text, Events) {
  v1::Event event;
  event.set_rig_s(1.5);
  event.mutable_ended()->set_session_id("s");
  event.mutable_ended()->set_reason("camera C3 is silent");
  EXPECT_NE(EventText(event).find("session s incomplete: camera C3 is silent"), std::string::npos);
  EXPECT_NE(JsonText(event).find("\"frames_durable\":0"), std::string::npos);
}

}  // namespace
}  // namespace mesorig::client
