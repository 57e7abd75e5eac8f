// Telegrams as LEGO MINDSTORMS NXT Direct Commands, appendix 2, lays them out.

#include "simulator/devices/nxt_brick/nxt_brick.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "protocol/base/bytes.h"

namespace mesorig::simulator {
namespace {

using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

Rig Demo() { return LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value(); }

std::string Bytes(std::initializer_list<int> values) {
  std::string bytes;
  for (int value : values) bytes += static_cast<char>(value);
  return bytes;
}

// Regulated, braking, port A.
std::string RunMotor(int power, int tacho_limit = 0) {
  return Bytes(
      {0x00, 0x04, 0, power, 0x07, 0x01, 0, 0x20, tacho_limit & 255, tacho_limit >> 8, 0, 0});
}

struct OutputState {
  uint8_t port, mode, regulation, run_state;
  int8_t power, turn_ratio;
  uint32_t limit;
  int32_t tacho, block, rotation;
};

class NxtBrickTest : public ::testing::Test {
 protected:
  // The reply, 7 ms later; empty when there is none.
  std::string Ask(RigTime at, const std::string& telegram) {
    RunUntil(at);
    brick_.Command(at, telegram, out_);
    EXPECT_TRUE(out_.Take().empty());
    if (brick_.NextEvent() > at + milliseconds(7)) return "";
    RunUntil(at + milliseconds(7));
    const auto said = out_.Take();
    EXPECT_LE(said.size(), 1u);
    return said.empty() ? "" : said[0];
  }
  OutputState State(RigTime at, int port = 0) {
    const std::string reply = Ask(at, Bytes({0x00, 0x06, port}));
    EXPECT_EQ(reply.size(), 25u);
    EXPECT_EQ(reply.substr(0, 3), Bytes({0x02, 0x06, 0x00}));
    ByteReader in(std::string_view(reply).substr(3));
    OutputState state{};
    state.port = in.Get<uint8_t>();
    state.power = in.Get<int8_t>();
    state.mode = in.Get<uint8_t>();
    state.regulation = in.Get<uint8_t>();
    state.turn_ratio = in.Get<int8_t>();
    state.run_state = in.Get<uint8_t>();
    state.limit = in.Get<uint32_t>();
    state.tacho = in.Get<int32_t>();
    state.block = in.Get<int32_t>();
    state.rotation = in.Get<int32_t>();
    EXPECT_TRUE(in.done());
    return state;
  }
  void RunUntil(RigTime t) {
    while (brick_.NextEvent() <= t) brick_.RunEvent(brick_.NextEvent(), out_);
  }

  const Rig rig_ = Demo();
  Contactor contactor_;
  LaserUnit unit_{rig_, 5, contactor_};
  NxtBrick brick_{rig_, unit_};
  sim_wire::Outbox out_;
};

TEST_F(NxtBrickTest, BatteryAndKeepAlive) {
  const std::string battery = Ask(seconds(1), Bytes({0x00, 0x0B}));
  ASSERT_EQ(battery.size(), 5u);
  EXPECT_EQ(battery.substr(0, 3), Bytes({0x02, 0x0B, 0x00}));
  const int mv =
      static_cast<unsigned char>(battery[3]) + 256 * static_cast<unsigned char>(battery[4]);
  EXPECT_EQ(mv, 7999);
  // 600,000 ms = 0x000927C0.
  EXPECT_EQ(Ask(seconds(2), Bytes({0x00, 0x0D})),
            Bytes({0x02, 0x0D, 0x00, 0xC0, 0x27, 0x09, 0x00}));
  EXPECT_EQ(Ask(seconds(3), Bytes({0x01, 0x88})), Bytes({0x02, 0x88, 0x00, 124, 1, 31, 1}));
  EXPECT_EQ(Ask(seconds(4), Bytes({0x01, 0x88, 0})), Bytes({0x02, 0x88, 0xBF}));
  EXPECT_EQ(Ask(seconds(5), Bytes({0x01, 0x9B})), Bytes({0x02, 0x9B, 0xBE})) << "not known here";
}

TEST_F(NxtBrickTest, AnswersSevenMillisecondsLater) {
  brick_.Command(seconds(1), Bytes({0x00, 0x0B}), out_);
  brick_.Command(seconds(1), Bytes({0x00, 0x0D}), out_);
  EXPECT_EQ(brick_.NextEvent(), RigTime(milliseconds(1007)));
  brick_.RunEvent(milliseconds(1007), out_);
  EXPECT_EQ(out_.Take().size(), 1u);
  EXPECT_EQ(brick_.NextEvent(), RigTime(milliseconds(1014))) << "one after the other";
}

TEST_F(NxtBrickTest, RunsRegulated) {
  EXPECT_EQ(Ask(seconds(1), RunMotor(20)), Bytes({0x02, 0x04, 0x00}));
  const OutputState before = State(seconds(2)), after = State(seconds(4));
  EXPECT_EQ(before.power, 20);
  EXPECT_EQ(before.mode, 0x07);
  EXPECT_EQ(before.run_state, 0x20);
  // 20 % of 900 degrees a second, 60 ms of run-up: 180 (1 - 0.06) = 169.2.
  EXPECT_EQ(before.tacho, 169);
  EXPECT_NEAR(after.tacho - before.tacho, 360, 1);
  EXPECT_EQ(State(seconds(5), 1).tacho, 0) << "nothing hangs on port B";
  EXPECT_EQ(Ask(seconds(6), RunMotor(-50)), Bytes({0x02, 0x04, 0x00}));
  EXPECT_LT(State(seconds(8)).tacho, State(seconds(7)).tacho);
}

TEST_F(NxtBrickTest, StopsSomeDegreesBeyondItsLimit) {
  Ask(seconds(1), RunMotor(50, 720));
  EXPECT_EQ(State(seconds(2)).run_state, 0x20);
  const OutputState state = State(seconds(5));
  EXPECT_EQ(state.run_state, 0x00);
  // 450 degrees a second, braked with 15 ms: 6.7 degrees.
  EXPECT_NEAR(state.block, 727, 1);
  EXPECT_EQ(State(seconds(50)).tacho, state.tacho);
  Ask(seconds(60), RunMotor(-50, 720));
  EXPECT_NEAR(State(seconds(70)).block, -727, 1);
}

TEST_F(NxtBrickTest, CountersAreResetApart) {
  Ask(seconds(1), RunMotor(50, 360));
  const OutputState moved = State(seconds(5));
  EXPECT_EQ(moved.tacho, moved.rotation);
  EXPECT_EQ(Ask(seconds(6), Bytes({0x00, 0x0A, 0, 0})), Bytes({0x02, 0x0A, 0x00}));
  OutputState state = State(seconds(7));
  EXPECT_EQ(state.rotation, 0);
  EXPECT_EQ(state.block, moved.block);
  EXPECT_EQ(state.tacho, moved.tacho);
  EXPECT_EQ(Ask(seconds(8), Bytes({0x00, 0x0A, 0, 1})), Bytes({0x02, 0x0A, 0x00}));
  state = State(seconds(9));
  EXPECT_EQ(state.block, 0);
  EXPECT_EQ(state.tacho, moved.tacho);
}

TEST_F(NxtBrickTest, CoastsAndBrakes) {
  Ask(seconds(1), RunMotor(100));
  const int32_t at = State(seconds(2)).tacho;
  Ask(seconds(2) + milliseconds(7), Bytes({0x00, 0x04, 0, 0, 0x00, 0, 0, 0x00, 0, 0, 0, 0}));
  // 900 degrees a second for 7 ms, then a quarter of a second of coasting: 6 + 225.
  EXPECT_NEAR(State(seconds(8)).tacho - at, 231, 2);
}

TEST_F(NxtBrickTest, TelegramsWithoutReply) {
  std::string run = RunMotor(20);
  run[0] = static_cast<char>(0x80);
  EXPECT_EQ(Ask(seconds(1), run), "");
  EXPECT_GT(State(seconds(2)).tacho, 100);
  EXPECT_EQ(Ask(seconds(3), Bytes({0x80, 0x77})), "") << "not even for an error";
}

TEST_F(NxtBrickTest, ErrorCodes) {
  const auto status = [&](std::initializer_list<int> telegram) {
    static RigTime at = seconds(1);
    at += seconds(1);
    const std::string reply = Ask(at, Bytes(telegram));
    return reply.size() < 3 ? -1 : static_cast<int>(static_cast<unsigned char>(reply[2]));
  };
  EXPECT_EQ(status({0x00, 0x99}), 0xBE);
  EXPECT_EQ(status({0x00}), 0xBF);
  EXPECT_EQ(status({0x00, 0x04, 0, 10}), 0xBF);
  EXPECT_EQ(status({0x00, 0x0B, 0}), 0xBF);
  EXPECT_EQ(status({0x00, 0x04, 3, 10, 7, 1, 0, 0x20, 0, 0, 0, 0}), 0xC0) << "port";
  EXPECT_EQ(status({0x00, 0x04, 0, 101, 7, 1, 0, 0x20, 0, 0, 0, 0}), 0xC0) << "power";
  EXPECT_EQ(status({0x00, 0x04, 0, 10, 7, 2, 0, 0x20, 0, 0, 0, 0}), 0xC0) << "synchronised";
  EXPECT_EQ(status({0x00, 0x04, 0, 10, 7, 1, 0, 0x10, 0, 0, 0, 0}), 0xC0) << "ramp-up";
  EXPECT_EQ(status({0x00, 0x0A, 3, 0}), 0xC0);
  EXPECT_EQ(Ask(seconds(100), Bytes({0x00, 0x06, 3})).size(), 25u) << "an error and zeros";
  EXPECT_EQ(status({0x01, 0x9B}), 0xBE) << "a system command that it does not know";
  EXPECT_EQ(status({0x03, 0x88}), -1) << "another kind of telegram is left unanswered";
}

TEST_F(NxtBrickTest, SleepsAfterTenMinutes) {
  Ask(seconds(1), RunMotor(10));
  RunUntil(minutes(9));
  EXPECT_TRUE(brick_.on());
  EXPECT_NE(Ask(minutes(9), Bytes({0x00, 0x0D})), "");
  RunUntil(minutes(18));
  EXPECT_TRUE(brick_.on()) << "kept awake";
  RunUntil(minutes(19));
  EXPECT_FALSE(brick_.on());
  EXPECT_EQ(unit_.motor().Speed(minutes(20)), 0);
  EXPECT_EQ(Ask(minutes(20), Bytes({0x00, 0x0D})), "");
  ASSERT_TRUE(brick_.Inject(minutes(21), "switch on", out_).ok());
  EXPECT_NE(Ask(minutes(21), Bytes({0x00, 0x0D})), "");
  EXPECT_FALSE(brick_.Inject(minutes(21), "dance", out_).ok());
  EXPECT_FALSE(brick_.Inject(minutes(21), "mount slant", out_).ok()) << "the door is closed";
}

// The emitter follows the motor only outside the play: 30 degrees of the motor, 1/240 of them.
TEST_F(NxtBrickTest, TiltIsNotWhatTheTachometerSays) {
  const double start = unit_.Tilt(seconds(1));
  Ask(seconds(1), RunMotor(50, 2400));
  const int32_t forward = State(seconds(20)).tacho;
  EXPECT_NEAR(DegFromRad(unit_.Tilt(seconds(20)) - start), (forward - 15) / 240.0, 0.003);
  Ask(seconds(21), RunMotor(-50, forward));
  const int32_t back = State(seconds(40)).tacho;
  EXPECT_NEAR(DegFromRad(unit_.Tilt(seconds(40)) - start), (back + 15) / 240.0, 0.003);
}

// Whatever arrives, the brick answers with one reply of a known form or not at all, and the motor
// stays a finite thing.
TEST_F(NxtBrickTest, SurvivesMutatedTelegrams) {
  const std::vector<std::string> valid = {RunMotor(30, 500),      RunMotor(-70),
                                          Bytes({0x00, 0x06, 0}), Bytes({0x00, 0x0A, 0, 1}),
                                          Bytes({0x00, 0x0B}),    Bytes({0x00, 0x0D})};
  std::mt19937 random(11);
  RigTime now = seconds(1);
  int replies = 0;
  for (int n = 0; n < 5000; ++n) {
    std::string telegram = valid[random() % valid.size()];
    for (auto edit = random() % 3; edit > 0 && !telegram.empty(); --edit) {
      const size_t at = random() % telegram.size();
      switch (random() % 4) {
        case 0:
          telegram[at] = static_cast<char>(random());
          break;
        case 1:
          telegram.resize(at);
          break;
        case 2:
          telegram.insert(at, random() % 80, static_cast<char>(random()));
          break;
        default:
          telegram[at] = static_cast<char>(telegram[at] ^ (1 << random() % 8));
          break;
      }
    }
    now += milliseconds(10 + random() % 100);
    const std::string reply = Ask(now, telegram);
    ASSERT_TRUE(std::isfinite(unit_.Tilt(now)));
    if (reply.empty()) continue;
    ++replies;
    ASSERT_GE(reply.size(), 3u);
    ASSERT_EQ(reply[0], 0x02);
    ASSERT_EQ(reply[1], telegram.size() > 1 ? telegram[1] : 0);
    const int status = static_cast<unsigned char>(reply[2]);
    ASSERT_TRUE(status == 0 || status == 0xBE || status == 0xBF || status == 0xC0) << status;
  }
  EXPECT_GT(replies, 1000);
}

}  // namespace
}  // namespace mesorig::simulator
