#include "client/cli/status_screen.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

namespace mesorig::client {
namespace {

using ::testing::HasSubstr;

v1::StatusReply Busy() {
  v1::StatusReply status;
  status.set_state(v1::RUNNING);
  status.set_session_id("20261122T182112.135Z-wang2005");
  status.set_shots(9216);
  status.set_shots_done(2304);
  status.set_frames(73728);
  status.set_frames_durable(18432);
  status.set_rig_s(7200);
  status.set_estimated_s(28800);
  status.set_remaining_s(21600);
  status.set_bytes_left(80'000'000'000);
  status.set_disk_free_bytes(50'000'000'000);
  status.set_alarms(2);
  status.set_deterministic(true);
  for (int i = 0; i < 12; ++i) {
    auto& consumer = *status.add_consumers();
    consumer.set_peer(fmt::format("ipv4:10.0.0.{}:51234", i));
    consumer.set_streams(8);
  }
  const auto add = [&](const std::string& name, const char* unit, double value, double age_s) {
    auto& reading = *status.add_readings();
    reading.set_name(name);
    reading.set_unit(unit);
    reading.set_value(value);
    reading.set_age_s(age_s);
  };
  add("estop", "closed", 1, 0.1);
  add("door", "closed", 0, 100);
  for (int i = 0; i < 30; ++i) add(fmt::format("light_arc_{}", i), "rad", -1234.5678, 12345);
  auto& prompt = *status.mutable_prompt();
  prompt.set_text(std::string(300, 'm') + "\x1b[2J\nsecond line");
  return status;
}

TEST(StatusScreen, FitsWhateverThereIs) {
  v1::HelloReply hello;
  hello.set_server("mesorigd 0.1.0");
  hello.set_rig_name(std::string(200, 'r'));
  std::vector<v1::Event> events(40);
  for (size_t i = 0; i < events.size(); ++i) {
    events[i].set_sequence(i);
    events[i].set_note(std::string(100, 'n'));
  }
  const std::string screen = StatusScreen(hello, Busy(), events);
  EXPECT_EQ(std::count(screen.begin(), screen.end(), '\n'), 24) << screen;
  std::istringstream lines(screen);
  std::string line;
  while (std::getline(lines, line)) EXPECT_LE(line.size(), 80u) << line;
  EXPECT_EQ(screen.find('\x1b'), screen.npos) << "no client moves the cursor";
  EXPECT_THAT(screen, HasSubstr("door OPEN (100.0 s ago)"));
  EXPECT_THAT(screen, HasSubstr("THE SESSION WILL NOT FIT"));
  EXPECT_THAT(screen, HasSubstr("2304/9216 shots"));
  EXPECT_THAT(screen, HasSubstr("6 h 0 min to go"));
  EXPECT_THAT(screen, HasSubstr("and 10 more"));
  EXPECT_THAT(screen, HasSubstr("39 ")) << "the latest event";
}

TEST(StatusScreen, APromptIsReadToItsEnd) {
  v1::StatusReply status;
  status.mutable_prompt()->set_text(
      "Mount the laser at \"zenith\" and line its stripe up with the turntable's centre. Then "
      "close "
      "the door and press reset.");
  const std::string screen = StatusScreen({}, status, {});
  EXPECT_THAT(screen, HasSubstr("asks      Mount the laser at \"zenith\""));
  EXPECT_THAT(screen, HasSubstr("press reset.\n"));
  EXPECT_THAT(screen, HasSubstr("needs     the door opened and closed, reset pressed, "
                                "`mesorig acknowledge`\n"));
}

TEST(StatusScreen, AnIdleDaemonSaysSo) {
  const std::string screen = StatusScreen({}, {}, {});
  EXPECT_THAT(screen, HasSubstr("session   none yet"));
  EXPECT_THAT(screen, HasSubstr("estop never read")) << "never shown as closed";
  EXPECT_LE(std::count(screen.begin(), screen.end(), '\n'), 24);
}

}  // namespace
}  // namespace mesorig::client
