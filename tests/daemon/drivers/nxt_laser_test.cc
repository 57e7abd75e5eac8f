// The driver against a brick in memory whose bytes are written down here from the manual, not taken
// from the driver or the simulator.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "daemon/drivers/driver.h"
#include "daemon/drivers/nxt_laser/nxt_brick.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

std::string Bytes(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes.push_back(static_cast<char>(value));
  return bytes;
}

// A motor that turns at exactly its regulated speed and stops at its limit, or braked, at once.
class MemoryBrick final : public UsbPort {
 public:
  explicit MemoryBrick(RigClock& clock) : clock_(clock) {}
  std::vector<std::string> telegrams;
  bool off = false;
  std::function<std::string(std::string)> meddle;  // what becomes of a reply
  int battery_mv = 7900, protocol = 1;
  double full_speed_deg_s = 900;
  double runs_on_s = 0;    // let go, the motor turns on for so long
  double overshoot_s = 0;  // likewise after its limit

  Status Write(std::string_view packet) override {
    telegrams.emplace_back(packet);
    if (off) return OkStatus();
    std::string reply = Answer(std::string(packet));
    if (meddle) reply = meddle(reply);
    Say(reply);
    return OkStatus();
  }
  void OnPacket(std::function<void(RigTime, std::string)> handler) override {
    handler_ = std::move(handler);
  }
  double position_deg() const {
    const double moved = speed_ * Seconds(clock_.Now() - since_);
    if (limit_ > 0 && std::abs(moved) >= limit_) return at_ + std::copysign(limit_, speed_);
    return at_ + moved;
  }
  void Say(const std::string& packet) {
    clock_.Change([&] { handler_(RigTime{}, packet); });
  }
  // Its supply was gone: counters begin at 0.
  void Restart() {
    at_ = speed_ = limit_ = 0;
    tacho_zero_ = 0;
    since_ = clock_.Now();
  }
  bool running() const {
    return speed_ != 0 &&
           !(limit_ > 0 && std::abs(speed_ * Seconds(clock_.Now() - since_)) >= limit_);
  }

 private:
  std::string Answer(const std::string& telegram) {
    const auto command = static_cast<uint8_t>(telegram[1]);
    switch (command) {
      case 0x04: {
        EXPECT_EQ(telegram.size(), 12u);
        const double at = position_deg();
        since_ = clock_.Now();
        at_ = at;
        const auto power = static_cast<int8_t>(telegram[3]);
        const bool on = (telegram[4] & 1) != 0 && telegram[7] == 0x20;
        const bool brakes = (telegram[4] & 2) != 0;
        const double let_go = on || brakes || !running() ? 0 : speed_;
        power_ = power;
        speed_ = on ? power / 100.0 * full_speed_deg_s : let_go;
        uint32_t limit = 0;
        std::memcpy(&limit, telegram.data() + 8, sizeof(limit));
        limit_ = on ? limit : std::abs(let_go) * runs_on_s;
        if (limit > 0) limit_ += std::abs(speed_) * overshoot_s;
        driven_ = on;
        if (limit_ == 0 && !on) speed_ = 0;
        return Bytes({2, 4, 0});
      }
      case 0x06: {
        EXPECT_EQ(telegram.size(), 3u);
        std::string reply = Bytes(
            {2, 6, 0, telegram[2], power_, 0, 0, 0, driven_ && (power_ == 0 || running()) ? 0x20 : 0});
        const auto rotation = static_cast<int32_t>(std::floor(position_deg()));
        for (const int32_t number : {0, rotation + tacho_zero_, 0, rotation}) {  // limit, tacho, block
          for (int i = 0; i < 4; ++i) reply.push_back(static_cast<char>(number >> (8 * i)));
        }
        return reply;
      }
      case 0x0A:
        tacho_zero_ += static_cast<int32_t>(std::floor(position_deg()));
        at_ = 0;
        since_ = clock_.Now();
        return Bytes({2, 0x0A, 0});
      case 0x0B:
        return Bytes({2, 0x0B, 0, battery_mv & 255, battery_mv >> 8});
      case 0x0D:
        return Bytes({2, 0x0D, 0, 0xC0, 0x27, 0x09, 0x00});  // 600,000 ms
      case 0x88:
        EXPECT_EQ(telegram, Bytes({1, 0x88}));
        return Bytes({2, 0x88, 0, 124, protocol, 31, 1});
    }
    ADD_FAILURE() << "unknown command " << int{command};
    return Bytes({2, command, 0xBE});
  }
  RigClock& clock_;
  std::function<void(RigTime, std::string)> handler_ = [](RigTime, std::string) {};
  double at_ = 0, speed_ = 0, limit_ = 0;
  int power_ = 0;
  bool driven_ = false;  // by the last command, be it to stand
  int32_t tacho_zero_ = 0;
  RigTime since_{};
};

class NxtLaserTest : public ::testing::Test {
 protected:
  NxtLaserTest() {
    context_.clock = &clock_;
    context_.rig = &rig_;
    context_.stop = &stop_;
    context_.usb = &brick_;
    laser_ = MakeLineLaser("nxt_laser", context_).value();
  }
  const Rig rig_ = SmallLaserRig();
  FakeRigClock clock_;
  RigClock::Member member_{clock_, "test"};
  RigClock::Activity activity_{clock_, Pace::kFree};
  StopFlag stop_{clock_};
  MemoryBrick brick_{clock_};
  DriverContext context_;
  std::unique_ptr<LineLaser> laser_;
};

// The telegrams of the manual, byte for byte.
TEST_F(NxtLaserTest, SpeaksTheManualsTelegrams) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  EXPECT_EQ(brick_.telegrams[0], Bytes({0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));  // motor off
  EXPECT_EQ(brick_.telegrams[1], Bytes({1, 0x88}));  // versions
  EXPECT_EQ(brick_.telegrams[2], Bytes({0, 0x0B}));
  EXPECT_EQ(brick_.telegrams[3], Bytes({0, 0x0D}));
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  EXPECT_EQ(brick_.telegrams[4], Bytes({0, 0x0A, 0, 0}));
  EXPECT_EQ(brick_.telegrams[5], Bytes({0, 6, 0}));
  // 900 deg/s at power 100 behind 1:240: 0.5625 deg/s is power 15.
  EXPECT_NEAR(laser_->StartSweep(RadFromDeg(0.5625)).value(), RadFromDeg(0.5625), 1e-9);
  EXPECT_EQ(brick_.telegrams[6], Bytes({0, 4, 0, 15, 7, 1, 0, 0x20, 0, 0, 0, 0}));
  ASSERT_TRUE(laser_->Read().ok());
  EXPECT_EQ(brick_.telegrams[7], Bytes({0, 6, 0}));
}

TEST_F(NxtLaserTest, SweepPassesItsStartAtSpeedWithThePlayTakenUp) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  for (const double sign : {1.0, -1.0}) {
    const double from = sign * RadFromDeg(-2), rate = sign * RadFromDeg(0.58);
    ASSERT_EQ(laser_->Prepare(from, rate), OkStatus());
    const double start = RadFromDeg(brick_.position_deg()) / 240;
    // At least the backlash of 30 deg of the motor before the first frame.
    EXPECT_GE(sign * (from - start), RadFromDeg(30.0 / 240));
    EXPECT_LE(sign * (from - start), RadFromDeg(150.0 / 240));
    const double actual = laser_->StartSweep(rate).value();
    EXPECT_LE(std::abs(actual), std::abs(rate));
    EXPECT_GE(std::abs(actual), 0.9 * std::abs(rate));  // whole powers
    ASSERT_EQ(laser_->AwaitTilt(from, clock_.Now() + std::chrono::seconds(5)), OkStatus());
    EXPECT_NEAR(laser_->Read().value().tilt_rad, from, RadFromDeg(0.02));
    EXPECT_TRUE(laser_->Read().value().moving);
    ASSERT_EQ(laser_->Stop(), OkStatus());
    EXPECT_FALSE(laser_->Read().value().moving);
  }
}

// Else a sweep that follows another begins elsewhere than the same sweep after a restart.
TEST_F(NxtLaserTest, SweepBeginsAtTheSamePlaceWhereverTheMotorCameFrom) {
  brick_.runs_on_s = 0.5;
  brick_.overshoot_s = 0.015;
  ASSERT_EQ(laser_->Open(), OkStatus());
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  for (const double from_deg : {-2.0, 1.5}) {  // seen from zero, on both sides of it
    const double from = RadFromDeg(from_deg), rate = RadFromDeg(0.58);
    ASSERT_EQ(laser_->Prepare(from, rate), OkStatus());
    const double first_deg = brick_.position_deg();
    ASSERT_TRUE(laser_->StartSweep(rate).ok());
    clock_.SleepFor(FromSeconds(3.3337));
    ASSERT_EQ(laser_->Stop(), OkStatus());
    ASSERT_TRUE(brick_.running()) << "it still runs out";
    ASSERT_EQ(laser_->Prepare(from, rate), OkStatus());
    EXPECT_NEAR(brick_.position_deg(), first_deg, 1) << "it stopped at no whole degree";
    EXPECT_FALSE(brick_.running());
    ASSERT_EQ(laser_->Prepare(RadFromDeg(-4), rate), OkStatus());
    ASSERT_EQ(laser_->Prepare(from, rate), OkStatus());
    EXPECT_NEAR(brick_.position_deg(), first_deg, 1);
  }
}

TEST_F(NxtLaserTest, RefusesWhatTheUnitCannotDo) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  EXPECT_TRUE(absl::IsInvalidArgument(laser_->Prepare(RadFromDeg(6.1), 0.01)));
  EXPECT_TRUE(absl::IsInvalidArgument(laser_->Prepare(std::nan(""), 0.01)));
  for (const double rate : {0.0, RadFromDeg(0.03), RadFromDeg(4.0), std::nan("")}) {
    EXPECT_TRUE(absl::IsInvalidArgument(laser_->Prepare(0, rate))) << rate;
    EXPECT_TRUE(absl::IsInvalidArgument(laser_->StartSweep(rate).status())) << rate;
  }
  brick_.battery_mv = 6100;
  EXPECT_THAT(std::string(Message(laser_->Open())), HasSubstr("6.10 V"));
}

TEST_F(NxtLaserTest, ABrickOfAnotherProtocolIsRefused) {
  brick_.protocol = 2;
  EXPECT_THAT(std::string(Message(laser_->Open())),
              HasSubstr("the brick speaks protocol 2.124 (firmware 1.31), 1 is spoken here"));
}

// Of packets that nobody asked for few are kept, and the next exchange goes on.
TEST_F(NxtLaserTest, ADeviceThatNeverStopsTalkingFillsNoMemory) {
  nxt_laser::NxtBrick brick(clock_, brick_);
  for (int i = 0; i < 1000; ++i) brick_.Say(Bytes({2, 6, 0}));
  EXPECT_EQ(brick.counts().unasked, 992u);
  EXPECT_NEAR(brick.BatteryVolts().value(), 7.9, 1e-9);
}

TEST_F(NxtLaserTest, BrickThatIsOffIsNamedInTime) {
  brick_.off = true;
  const RigTime before = clock_.Now();
  EXPECT_THAT(std::string(Message(laser_->Open())), HasSubstr("the brick is off"));
  EXPECT_LE(Seconds(clock_.Now() - before), 3.01) << "a stop is tried three times";
  brick_.off = false;
  EXPECT_EQ(laser_->Open(), OkStatus()) << "and opens again";
}

TEST_F(NxtLaserTest, BrickThatWasOffHasLostItsZero) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  ASSERT_EQ(laser_->Prepare(RadFromDeg(2), RadFromDeg(0.5)), OkStatus());
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  ASSERT_EQ(laser_->Prepare(RadFromDeg(1), RadFromDeg(0.5)), OkStatus());
  brick_.Restart();
  ASSERT_EQ(laser_->Open(), OkStatus());
  const Status status = laser_->Prepare(RadFromDeg(1), RadFromDeg(0.5));
  EXPECT_TRUE(absl::IsUnavailable(status));
  EXPECT_THAT(std::string(Message(status)), HasSubstr("laser line_laser: its zero is lost"));
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  EXPECT_EQ(laser_->Prepare(RadFromDeg(1), RadFromDeg(0.5)), OkStatus());
}

// A reply that comes after its exchange was given up is not taken for the next one's.
TEST_F(NxtLaserTest, LateRepliesAreToldApart) {
  nxt_laser::NxtBrick brick(clock_, brick_);
  std::string held;
  brick_.meddle = [&](std::string reply) { return std::exchange(held, reply); };  // one behind
  EXPECT_TRUE(absl::IsUnavailable(brick.BatteryVolts().status()));  // (an empty packet)
  EXPECT_TRUE(absl::IsUnavailable(brick.GetOutput(0).status()));
  brick_.meddle = nullptr;
  EXPECT_NEAR(brick.BatteryVolts().value(), 7.9, 1e-9);
  EXPECT_TRUE(brick.GetOutput(0).ok());
  EXPECT_EQ(brick.counts().damaged, 1u);
  EXPECT_GE(brick.counts().foreign, 1u);
}

TEST_F(NxtLaserTest, StopFlagEndsTheWayThereButNotTheStop) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  stop_.Raise("a hand said stop");
  EXPECT_TRUE(absl::IsCancelled(laser_->Prepare(RadFromDeg(3), 0.01)));
  EXPECT_EQ(laser_->Stop(), OkStatus());
  EXPECT_FALSE(brick_.running());
}

TEST_F(NxtLaserTest, KeepsTheBrickAwakeOnceAMinute) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  brick_.telegrams.clear();
  for (int i = 0; i < 300; ++i) {
    clock_.SleepFor(std::chrono::seconds(1));
    ASSERT_EQ(laser_->KeepAlive(), OkStatus());
  }
  EXPECT_EQ(brick_.telegrams.size(), 5u);
}

// Replies that are cut, of another command, refused or changed: an error, never a wrong number.
TEST_F(NxtLaserTest, HostileRepliesAreErrors) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  brick_.meddle = [](std::string reply) { return reply.substr(0, reply.size() - 1); };
  EXPECT_FALSE(laser_->Read().ok());
  brick_.meddle = [](std::string reply) { return reply + "x"; };
  EXPECT_FALSE(laser_->Read().ok());
  brick_.meddle = [](std::string reply) { return reply[2] = 0x20, reply; };
  EXPECT_THAT(std::string(Message(laser_->Read().status())), HasSubstr("0x20"));
  brick_.meddle = [](std::string reply) { return reply[1] = 0x07, reply; };
  EXPECT_FALSE(laser_->Read().ok());
  brick_.meddle = [](std::string reply) { return reply[3] = 2, reply; };
  EXPECT_THAT(std::string(Message(laser_->Read().status())), HasSubstr("motor 2 answered"));
  std::mt19937 random(5);
  for (int i = 0; i < 3000; ++i) {
    brick_.meddle = [&](std::string reply) {
      reply.resize(random() % 40);
      for (char& c : reply) c = random() % 3 == 0 ? static_cast<char>(random()) : c;
      return reply;
    };
    if (const auto reading = laser_->Read(); reading.ok()) {
      EXPECT_TRUE(std::isfinite(reading->tilt_rad));
    }
  }
}

}  // namespace
}  // namespace mesorig::daemon
