// What can be injected: the faults of messages, of a CAN node and of a camera, and the table and
// scripts of them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <random>
#include <sstream>

#include "simulator/devices/camera/camera_device.h"
#include "simulator/devices/cia402_node/can_bus.h"
#include "simulator/devices/faults/fault_script.h"
#include "simulator/devices/faults/fault_table.h"
#include "simulator/devices/faults/faulty_device.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"
#include "tests/fixtures/small_rig.h"

namespace mesorig::simulator {
namespace {

using fixtures::SmallLaserRig;
using fixtures::SmallRig;
using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Says what it hears; answers questions with themselves.
class Echo final : public sim_wire::SimDevice {
 public:
  std::string name() const override { return "echo"; }
  void Command(RigTime, std::string_view payload, sim_wire::Outbox& out) override {
    out.Send(std::string(payload));
  }
  StatusOr<std::string> Query(RigTime, std::string_view payload, sim_wire::Outbox&) override {
    return std::string(payload);
  }
  RigTime NextEvent() const override { return kNever; }
  void RunEvent(RigTime, sim_wire::Outbox&) override {}
  void Plug(RigTime, bool plugged, sim_wire::Outbox& out) override {
    if (plugged) out.Send("booted");
  }
};

class FaultyDeviceTest : public ::testing::Test {
 protected:
  void Inject(std::string_view text) {
    EXPECT_EQ(device_.Inject(now_, text, out_), OkStatus()) << text;
  }
  std::vector<std::string> Say(std::string_view text) {
    device_.Command(now_, text, out_);
    return out_.Take();
  }
  Echo echo_;
  FaultyDevice device_{echo_};
  sim_wire::Outbox out_;
  RigTime now_{milliseconds(100)};
};

TEST_F(FaultyDeviceTest, ChangesNothingByItself) {
  EXPECT_THAT(Say("a"), ElementsAre("a"));
  EXPECT_EQ(device_.Query(now_, "b", out_).value(), "b");
  EXPECT_EQ(device_.NextEvent(), kNever);
}

TEST_F(FaultyDeviceTest, DropsToEitherSide) {
  Inject("drop 2");
  EXPECT_THAT(Say("a"), IsEmpty());
  EXPECT_TRUE(absl::IsUnavailable(device_.Query(now_, "b", out_).status()));
  EXPECT_THAT(Say("c"), ElementsAre("c"));
  Inject("drop in");
  EXPECT_THAT(Say("d"), IsEmpty());
  EXPECT_THAT(Say("e"), ElementsAre("e"));
}

TEST_F(FaultyDeviceTest, DelaysSoThatOthersOvertake) {
  Inject("delay 50 2");
  EXPECT_THAT(Say("a"), IsEmpty());
  now_ += milliseconds(10);
  EXPECT_THAT(Say("b"), IsEmpty());
  EXPECT_THAT(Say("c"), ElementsAre("c"));
  EXPECT_EQ(device_.NextEvent(), RigTime(milliseconds(150)));
  device_.RunEvent(milliseconds(150), out_);
  EXPECT_THAT(out_.Take(), ElementsAre("a"));
  device_.RunEvent(milliseconds(160), out_);
  EXPECT_THAT(out_.Take(), ElementsAre("b"));
  EXPECT_EQ(device_.NextEvent(), kNever);
}

TEST_F(FaultyDeviceTest, DamagesOneByteTheSameWayEachTime) {
  Inject("corrupt 2");
  const auto first = Say("0123456789"), second = Say("0123456789");
  ASSERT_EQ(first.size(), 1u);
  int differ = 0;
  for (size_t i = 0; i < 10; ++i) differ += first[0][i] != "0123456789"[i] ? 1 : 0;
  EXPECT_EQ(differ, 1);
  FaultyDevice other(echo_);
  ASSERT_EQ(other.Inject(now_, "corrupt 2", out_), OkStatus());
  other.Command(now_, "0123456789", out_);
  EXPECT_EQ(out_.Take(), first);
  EXPECT_NE(second, first) << "another byte";
  Inject("duplicate");
  EXPECT_THAT(Say("a"), ElementsAre("a", "a"));
  EXPECT_THAT(Say("a"), ElementsAre("a"));
}

TEST_F(FaultyDeviceTest, UnpluggedUntilReplugged) {
  Inject("delay 50");
  EXPECT_THAT(Say("a"), IsEmpty());
  Inject("disconnect");
  EXPECT_THAT(Say("b"), IsEmpty());
  EXPECT_TRUE(absl::IsUnavailable(device_.Query(now_, "b", out_).status()));
  Inject("replug 300");
  EXPECT_EQ(device_.NextEvent(), RigTime(milliseconds(400))) << "what was on its way is lost";
  device_.RunEvent(milliseconds(400), out_);
  EXPECT_THAT(out_.Take(), ElementsAre("booted"));
  EXPECT_THAT(Say("c"), ElementsAre("c"));
}

TEST_F(FaultyDeviceTest, RefusesWhatItDoesNotKnow) {
  for (const char* bad : {"drop x", "drop -1", "drop 1 2", "drop 99999999999", "delay", "delay 0",
                          "delay 5 in out", "replug x", "disconnect 3", "explode", "", " "}) {
    EXPECT_TRUE(absl::IsInvalidArgument(device_.Inject(now_, bad, out_))) << bad;
  }
  EXPECT_THAT(Say("a"), ElementsAre("a"));
}

TEST(FaultTable, EveryFaultIsKnownToItsDevice) {
  const Rig rig = SmallLaserRig();
  for (const char* good :
       {"can drop", "can turntable corrupt 3 in", "can arc stuck", "can arc free",
        "can arc lose -3.5", "lamps dead L0", "lamps close", "lamps exception 2", "nxt delay 20 3",
        "nxt switch off", "lines stuck door", "lines door open", "camera:1000 silent",
        "camera:1001 clock -0.5", "camera:1000 replug 500", "rig leap 3"}) {
    EXPECT_EQ(CheckFault(rig, good), OkStatus()) << good;
  }
  for (const char* bad :
       {"", "can", "axis drop", "can turntable", "can base stuck", "lines stuck reset",
        "lines door ajar", "camera:9 drop", "rig drop", "rig leap", "lamps dead",
        "camera:1000 torn 1 2 3", "lamps stuck", "can stuck"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(CheckFault(rig, bad))) << bad;
  }
  EXPECT_FALSE(CheckFault(SmallRig(), "nxt drop").ok()) << "a rig without a laser";
}

TEST(FaultTable, StandsInTheReadme) {
  std::ifstream file(std::string(MESORIG_SOURCE_DIR) + "/simulator/devices/README.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_THAT(text.str(), HasSubstr(FaultHelp("    ")));
}

TEST(FaultScript, SortsByTimeAndNamesTheLine) {
  const Rig rig = SmallRig();
  const auto script = ParseFaultScript(
      "# a script\nat 5 can drop 3\r\n\n  at 2.5 camera:1000   silent # once\nat 5 lamps close",
      "f", rig);
  ASSERT_TRUE(script.ok()) << script.status();
  ASSERT_EQ(script->size(), 3u);
  EXPECT_EQ((*script)[0].at, RigTime(milliseconds(2500)));
  EXPECT_EQ((*script)[0].text, "camera:1000 silent");
  EXPECT_EQ((*script)[1].text, "can drop 3");
  const auto bad = [&](std::string_view text) {
    const auto parsed = ParseFaultScript(text, "faults.txt", rig);
    EXPECT_TRUE(absl::IsInvalidArgument(parsed.status())) << text;
    return std::string(Message(parsed.status()));
  };
  EXPECT_THAT(bad("\nat 3 canned drop"), HasSubstr("faults.txt:2: \"canned drop\": no device"));
  EXPECT_THAT(bad("at -1 can drop"), HasSubstr("faults.txt:1: at: \"-1\" is not a number in [0"));
  EXPECT_THAT(bad("at 1 can"), HasSubstr("is not: at SECONDS DEVICE FAULT"));
  EXPECT_THAT(bad("at nan can drop"), HasSubstr("faults.txt:1"));
  EXPECT_TRUE(absl::IsNotFound(LoadFaultScript("/nonexistent/f", rig).status()));
}

TEST(FaultScript, MutatedOnesAreReadOrRefused) {
  const Rig rig = SmallLaserRig();
  const std::string whole =
      "at 5 can turntable delay 20 3 in\nat 1e3 rig leap 2\nat 0 lines stuck door\n";
  std::mt19937 random(3);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = whole;
    for (int k = 0; k < 3; ++k) text[random() % text.size()] = static_cast<char>(random());
    if (i % 3 == 0) text.resize(random() % text.size());
    refused += ParseFaultScript(text, "f", rig).ok() ? 0 : 1;
  }
  EXPECT_GT(refused, 1000);
}

// Any words at any device: a status, never a crash.
TEST(FaultTable, HostileWordsAreRefused) {
  const Rig rig = SmallRig();
  Contactor contactor;
  CanBusDevice can(rig, 1, contactor);
  LampBankModel lamps(rig, contactor);
  FaultyDevices devices({&can, &lamps});
  std::mt19937 random(5);
  sim_wire::Outbox out;
  int refused = 0;
  for (int i = 0; i < 5000; ++i) {
    std::string text;
    for (int words = static_cast<int>(random() % 4); words >= 0; --words) {
      const auto& usage = AllFaults()[random() % AllFaults().size()].usage;
      const auto parts = FaultWords(usage);
      text += std::string(parts[random() % parts.size()]) + " ";
      if (random() % 3 == 0) text += std::to_string(static_cast<int32_t>(random())) + " ";
      if (random() % 5 == 0) text += "turntable ";
    }
    if (random() % 2 == 0) text[random() % text.size()] = static_cast<char>(random());
    for (sim_wire::SimDevice* device : devices.All()) {
      refused += device->Inject({}, text, out).ok() ? 0 : 1;
    }
  }
  EXPECT_GT(refused, 5000);
}

// A drive alone, driven by controlwords through SDO-less PDOs.
class NodeFaultsTest : public ::testing::Test {
 protected:
  NodeFaultsTest() {
    Send({0x000, 2, {1, 5}});
    Write(0x6065, 0, 4, 200);  // 2 deg
    SwitchOn();
  }
  void SwitchOn() {
    for (const uint16_t word : std::array<uint16_t, 3>{0x06, 0x07, 0x0F}) SetPoint(word, 0);
  }
  void Send(const sim_wire::CanFrame& frame) {
    bus_.Command(now_, sim_wire::Pack(frame), out_);
    Read();
  }
  void Write(uint16_t index, uint8_t sub, int size, uint32_t value) {
    sim_wire::CanFrame frame{0x605,
                             8,
                             {static_cast<uint8_t>(0x23 | (4 - size) << 2),
                              static_cast<uint8_t>(index), static_cast<uint8_t>(index >> 8), sub}};
    for (int i = 0; i < 4; ++i) frame.data[4 + i] = static_cast<uint8_t>(value >> (8 * i));
    Send(frame);
  }
  void SetPoint(uint16_t word, int32_t target) {
    sim_wire::CanFrame frame{
        0x405, 6, {static_cast<uint8_t>(word), static_cast<uint8_t>(word >> 8)}};
    for (int i = 0; i < 4; ++i)
      frame.data[2 + i] = static_cast<uint8_t>(static_cast<uint32_t>(target) >> (8 * i));
    Send(frame);
  }
  void Run(RigTime until) {
    while (bus_.NextEvent() <= until) {
      now_ = bus_.NextEvent();
      bus_.RunEvent(now_, out_);
      Read();
    }
    now_ = until;
  }
  void Read() {
    for (const std::string& said : out_.Take()) {
      const auto frame = sim_wire::UnpackCanFrame(said).value();
      if (frame.id == 0x705 && frame.data[0] == 0) ++boots_;
      if (frame.id != 0x385) continue;
      status_ = static_cast<uint16_t>(frame.data[0] | frame.data[1] << 8);
      uint32_t position = 0;
      for (int i = 0; i < 4; ++i) position |= uint32_t{frame.data[2 + i]} << (8 * i);
      position_ = static_cast<int32_t>(position);
    }
  }
  void Inject(std::string_view text) {
    EXPECT_EQ(bus_.Inject(now_, text, out_), OkStatus()) << text;
    Read();
  }
  bool reached() const { return (status_ & 0x400) != 0; }
  bool following_error() const { return (status_ & 0x2000) != 0; }
  double World() const { return bus_.node(0).WorldCounts(now_); }

  const Rig rig_ = SmallRig();  // 100 counts a degree
  Contactor contactor_;
  CanBusDevice bus_{rig_, 1, contactor_};
  sim_wire::Outbox out_;
  RigTime now_{};
  uint16_t status_ = 0;
  int32_t position_ = 0;
  int boots_ = 0;
};

TEST_F(NodeFaultsTest, LostStepsShowAtTheEncoder) {
  SetPoint(0x1F, 3000);
  Run(milliseconds(300));
  Inject("turntable lose 1");
  Run(std::chrono::seconds(5));
  EXPECT_TRUE(reached()) << "by its steps";
  EXPECT_EQ(position_, 2900);
  EXPECT_FALSE(following_error()) << "within its window";
  SetPoint(0x0F, 3000);
  SetPoint(0x1F, 4000);
  Run(std::chrono::seconds(9));
  EXPECT_EQ(position_, 3900) << "another move does not mend it";
  SetPoint(0x00, 0);
  SwitchOn();
  SetPoint(0x1F, 4000);
  Run(std::chrono::seconds(12));
  EXPECT_EQ(position_, 4000) << "torque off and on does";
}

TEST_F(NodeFaultsTest, StuckMotorIsAFollowingError) {
  SetPoint(0x1F, 3000);
  Run(milliseconds(300));
  Inject("turntable stuck");
  const double stood = World();
  Run(std::chrono::seconds(3));
  EXPECT_EQ(World(), stood);
  EXPECT_TRUE(following_error());
  EXPECT_FALSE(reached());
  EXPECT_FALSE(bus_.node(0).Moving(now_));
  Inject("turntable free");
  SetPoint(0x00, 0);
  SwitchOn();
  SetPoint(0x1F, 3000);
  Run(std::chrono::seconds(6));
  EXPECT_TRUE(reached());
  EXPECT_FALSE(following_error());
  EXPECT_EQ(position_, 3000);
}

TEST_F(NodeFaultsTest, StuckWhileHomingFindsNoSwitch) {
  Write(0x6060, 0, 1, 6);
  Inject("turntable stuck");
  SetPoint(0x1F, 0);
  Run(std::chrono::seconds(20));
  EXPECT_TRUE((status_ & 0x2000) != 0) << "homing error";
  EXPECT_FALSE((status_ & 0x1000) != 0) << "not attained";
}

TEST_F(NodeFaultsTest, FreedWhileHomingItFindsTheSwitch) {
  Write(0x6060, 0, 1, 6);
  Inject("turntable stuck");
  SetPoint(0x1F, 0);
  Run(milliseconds(300));
  Inject("turntable free");
  Run(std::chrono::seconds(60));
  EXPECT_TRUE((status_ & 0x1000) != 0) << "attained";
  EXPECT_NEAR(World(), 0, 0.5);
}

TEST_F(NodeFaultsTest, WithoutSupplyItStandsAndBootsAfterwards) {
  SetPoint(0x1F, 3000);
  Run(milliseconds(400));
  Inject("turntable disconnect");
  const double stood = World();
  EXPECT_FALSE(bus_.node(0).torque_on());
  Run(std::chrono::seconds(2));
  EXPECT_EQ(World(), stood);
  EXPECT_EQ(boots_, 0);
  Inject("turntable replug 500");
  Run(std::chrono::seconds(3));
  EXPECT_EQ(boots_, 1);
  Send({0x000, 2, {1, 5}});
  EXPECT_EQ(position_, 0) << "its encoder counts anew";
  EXPECT_EQ(World(), stood);
}

TEST_F(NodeFaultsTest, OnlyItsOwnMessagesCount) {
  Inject("turntable drop 1 in");
  Send({0x606, 8, {0x40, 0x41, 0x60, 0}});  // the other node's
  position_ = -1;
  SetPoint(0x1F, 3000);  // lost
  Run(std::chrono::seconds(3));
  EXPECT_NE(position_, 3000);
}

// Uniform light.
class FlatSource final : public ImageSource {
 public:
  Scene Observe(RigTime, RigTime) override { return {}; }
  StatusOr<std::vector<float>> ExpectedElectrons(int, const Scene& scene, double) override {
    return std::vector<float>(static_cast<size_t>(scene.region.width * scene.region.height), 500.F);
  }
};

class CameraFaultsTest : public ::testing::Test {
 protected:
  // What the camera says to a trigger.
  std::vector<StatusOr<sim_wire::CameraFrame>> Shoot(uint32_t id) {
    now_ += milliseconds(500);
    camera_.Command(now_, sim_wire::Pack(sim_wire::CameraTrigger{id}), out_);
    while (camera_.NextEvent() != kNever) camera_.RunEvent(camera_.NextEvent(), out_);
    std::vector<StatusOr<sim_wire::CameraFrame>> frames;
    for (const std::string& said : out_.Take()) frames.push_back(sim_wire::UnpackCameraFrame(said));
    return frames;
  }
  void Inject(std::string_view text) {
    EXPECT_EQ(camera_.Inject(now_, text, out_), OkStatus()) << text;
  }
  const Rig rig_ = SmallRig();
  FlatSource source_;
  CameraDevice camera_{rig_, 0, source_};
  sim_wire::Outbox out_;
  RigTime now_{};
};

TEST_F(CameraFaultsTest, SilentTornStaleAndWrongId) {
  ASSERT_TRUE(Shoot(1).at(0).ok());
  Inject("silent 1");
  EXPECT_TRUE(Shoot(2).empty());
  Inject("torn");
  EXPECT_TRUE(absl::IsDataLoss(Shoot(3).at(0).status()));
  Inject("wrong_id");
  EXPECT_NE(Shoot(4).at(0)->trigger_id, 4u);
  Inject("stale");
  const auto stale = *Shoot(5).at(0);
  EXPECT_EQ(stale.trigger_id, 5u);
  EXPECT_LT(stale.exposure_end, now_);
  EXPECT_EQ(Shoot(6).at(0)->trigger_id, 6u);
  Inject("clock -2.5");
  const auto jumped = *Shoot(7).at(0);
  EXPECT_EQ(jumped.exposure_start, now_ - milliseconds(2500));
}

TEST_F(CameraFaultsTest, BeginsAnewWithItsPlug) {
  ASSERT_TRUE(Shoot(1).at(0).ok());
  Inject("silent");
  EXPECT_TRUE(Shoot(2).empty());
  EXPECT_TRUE(Shoot(3).empty()) << "until it is replugged";
  camera_.Command(now_, sim_wire::Pack(sim_wire::CameraTrigger{4}), out_);
  camera_.Plug(now_, false, out_);
  EXPECT_EQ(camera_.NextEvent(), kNever);
  camera_.Plug(now_, true, out_);
  const auto frame = *Shoot(5).at(0);
  EXPECT_EQ(frame.frame_id, 1u);
  EXPECT_EQ(frame.exposure_start, RigTime(milliseconds(500))) << "its clock began at 0";
  for (const char* bad : {"silent x", "clock", "clock nan", "clock 1e99", "torn 1 2", ""}) {
    EXPECT_TRUE(absl::IsInvalidArgument(camera_.Inject(now_, bad, out_))) << bad;
  }
}

TEST(LampFaults, DeadLampGivesNoLight) {
  const Rig rig = SmallRig();
  Contactor contactor;
  LampBankModel lamps(rig, contactor);
  sim_wire::Outbox out;
  lamps.Switch(0, true, {});
  EXPECT_EQ(lamps.FluxPerMille(0, std::chrono::seconds(1)), 1000);
  ASSERT_EQ(lamps.Inject(std::chrono::seconds(1), "dead L0", out), OkStatus());
  EXPECT_TRUE(lamps.Coil(0));
  EXPECT_EQ(lamps.FluxPerMille(0, std::chrono::seconds(2)), 0);
  lamps.Switch(0, true, std::chrono::seconds(2));
  EXPECT_EQ(lamps.FluxPerMille(0, std::chrono::seconds(3)), 0);
  ASSERT_EQ(lamps.Inject(std::chrono::seconds(3), "alive L0", out), OkStatus());
  EXPECT_EQ(lamps.FluxPerMille(0, std::chrono::seconds(4)), 0);
  lamps.Switch(0, true, std::chrono::seconds(4));
  EXPECT_EQ(lamps.FluxPerMille(0, std::chrono::seconds(5)), 1000);
  EXPECT_TRUE(absl::IsNotFound(lamps.Inject({}, "dead L9", out)));
}

}  // namespace
}  // namespace mesorig::simulator
