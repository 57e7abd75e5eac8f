// A whole capture by mesorigd with its buses on the kernel's interfaces, and what goes wrong there.
// Its pictures are those of a run in lockstep with the same simulator.

#include <gmock/gmock.h>
#include <modbus/modbus.h>
#include <signal.h>

#include <algorithm>
#include <filesystem>

#include "tests/hil/real_rig.h"

namespace mesorig::test {
namespace {

using hil::Eventually;
using hil::Shell;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int kEstop = 0, kDoor = 1;
const std::set<std::string> kBuses = {"can", "gpio", "modbus", "usb"};

// Once for all tests.
const Frames& Local() {
  static const Frames frames = LocalFrames();
  return frames;
}

std::string Level(int line) {
  return Shell(fmt::format("cat /sys/devices/platform/gpio-sim.*/gpiochip*/sim_gpio{}/value", line));
}

// One rig for all tests, as starting it takes the guest longer than what happens to it; a test that
// failed leaves it to nobody, and one that took the daemon away has another one started.
class RealRigTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { files_ = std::make_unique<RigFiles>(kBuses); }
  static void TearDownTestSuite() {
    rig_.reset();
    files_.reset();
  }
  void SetUp() override {
    if (rig_ == nullptr) {
      rig_ = std::make_unique<RealRig>(*files_, kBuses, "modbus");
    } else if (!rig_->daemon().Running()) {
      rig_->StartDaemon();
    }
  }
  void TearDown() override {
    if (!HasFailure()) return;
    std::printf("%s", rig_->AllLogs().c_str());
    rig_.reset();
  }
  bool NothingIsOn() const {
    return AwaitRig(*rig_, [](const RigState& state) { return !state.AnythingOn(); });
  }

  static std::unique_ptr<RigFiles> files_;
  static std::unique_ptr<RealRig> rig_;
};
std::unique_ptr<RigFiles> RealRigTest::files_;
std::unique_ptr<RealRig> RealRigTest::rig_;

TEST_F(RealRigTest, CapturesAsOverTheSimulatorsWire) {
  std::string seen;
  std::thread witness([&] { seen = Shell("timeout 200 candump -L vcan0 | head -n 4000"); });
  ASSERT_TRUE(Eventually(hil::CandumpListens));
  EXPECT_THAT(Shell("gpioinfo rig-lines"),
              AllOf(HasSubstr("\"E-STOP\""), HasSubstr(fmt::format("\"mesorigd, process {}", rig_->daemon().pid()))));
  EXPECT_THAT(Shell("gpioget rig-lines 1"), HasSubstr("busy"));
  EXPECT_THAT(Shell("lsusb -v -d 0694:0002 | grep iSerial"), HasSubstr("0016530A1B2C"));
  const auto run = rig_->RunPlan(files_->plan());
  Shell("pkill candump");
  witness.join();
  EXPECT_EQ(run.value("complete", false), true) << rig_->AllLogs();
  EXPECT_EQ(run.value("deterministic", true), false) << "the clock is the system's";
  EXPECT_THAT(seen, AllOf(HasSubstr("vcan0 601#"), HasSubstr("vcan0 582#"), HasSubstr("vcan0 77F#05")));
  ExpectSame(FramesOf(*rig_, run.value("session_id", "")), Local());
}

// A second daemon is refused by the device's name; a Modbus client that is libmodbus and nothing of
// ours has the line when the daemon has let go of it.
TEST_F(RealRigTest, OneProcessHasTheBuses) {
  const TemporaryFolder other;
  std::filesystem::copy(rig_->folder() / "mesorig-sim.endpoint", other / "mesorig-sim.endpoint");
  const Outcome refused =
      RunProgram("mesorigd", {"--rig", (files_->folder / "real.toml").string(), "--state-dir",
                              (other / "state").string(), "--runtime-dir", other.path().string()});
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.text, AllOf(HasSubstr("vcan0"),
                                  HasSubstr(fmt::format("process {}", rig_->daemon().pid()))));
  ASSERT_EQ(rig_->daemon().End(SIGTERM), 0) << rig_->AllLogs();
  const std::unique_ptr<modbus_t, void (*)(modbus_t*)> client(
      modbus_new_rtu(files_->tty().c_str(), 19200, 'E', 8, 1), &modbus_free);
  modbus_set_slave(client.get(), 1);
  modbus_set_response_timeout(client.get(), 3, 0);
  ASSERT_EQ(modbus_connect(client.get()), 0) << modbus_strerror(errno);
  ASSERT_EQ(modbus_write_bit(client.get(), 0, 1), 1) << modbus_strerror(errno);
  ASSERT_TRUE(AwaitRig(*rig_, [](const RigState& state) { return IsOn(state, "lamp lamp0"); }));
  uint16_t flux = 0;
  ASSERT_TRUE(Eventually([&] {
    return modbus_read_input_registers(client.get(), 0, 1, &flux) == 1 && flux > 900;
  })) << flux;
  EXPECT_EQ(modbus_read_input_registers(client.get(), 500, 1, &flux), -1);
  EXPECT_EQ(errno, EMBXILADD) << modbus_strerror(errno);
  // It falls silent: the bank's communication timeout.
  EXPECT_TRUE(NothingIsOn());
  modbus_close(client.get());
}

TEST_F(RealRigTest, TheDoorOpensInACapture) {
  const auto run = rig_->BeginPlan();
  ASSERT_TRUE(AwaitRig(*rig_, LampAndTorque)) << run->Log() << rig_->AllLogs();
  EXPECT_EQ(Level(kDoor), "1\n");
  ASSERT_EQ(rig_->Inject({"lines", "door", "open"}).code, 0);
  EXPECT_TRUE(NothingIsOn()) << rig_->AllLogs();
  EXPECT_EQ(Level(kDoor), "0\n") << "and the kernel says so";
  ASSERT_TRUE(Eventually([&] { return !run->Running(); })) << run->Log();
  EXPECT_THAT(run->Log(), HasSubstr("door"));
  ASSERT_EQ(rig_->Inject({"lines", "door", "close"}).code, 0);
  ASSERT_EQ(rig_->Inject({"lines", "reset"}).code, 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(500));  // a hand on the button, debounced
  ASSERT_NO_FATAL_FAILURE(ExpectWholeInTheEnd(*rig_, *run, Local()));
}

TEST_F(RealRigTest, TheCanInterfaceGoesDownInACapture) {
  const auto run = rig_->BeginPlan();
  ASSERT_TRUE(AwaitRig(*rig_, LampAndTorque)) << run->Log() << rig_->AllLogs();
  Shell("ip link set vcan0 down");
  EXPECT_TRUE(NothingIsOn()) << "the drives watch the daemon's heartbeat, the daemon theirs" << rig_->AllLogs();
  Shell("ip link set vcan0 up");
  ASSERT_NO_FATAL_FAILURE(ExpectWholeInTheEnd(*rig_, *run, Local()));
}

TEST_F(RealRigTest, TheLampsLineHangsUpInACapture) {
  const auto run = rig_->BeginPlan();
  ASSERT_TRUE(AwaitRig(*rig_, LampAndTorque)) << run->Log() << rig_->AllLogs();
  rig_->Unplug();
  EXPECT_TRUE(AwaitRig(*rig_, [](const RigState& state) { return !IsOn(state, "lamp "); }))
      << "the bank's timeout";
  rig_->PlugIn("modbus");
  ASSERT_NO_FATAL_FAILURE(ExpectWholeInTheEnd(*rig_, *run, Local()));
}

// Nobody is left to switch anything off: the gate is a one-shot, the bank and the drives have watches.
TEST_F(RealRigTest, KilledWithEverythingOn) {
  const EverythingOnByHand everything(*rig_);
  ASSERT_TRUE(everything.on());
  ASSERT_EQ(rig_->Inject({"can", "turntable", "free"}).code, 0);  // leaves the time in the log
  const double killed_s = ReadRig(*rig_).injected_s;
  ASSERT_EQ(::kill(rig_->daemon().pid(), SIGKILL), 0);
  ASSERT_TRUE(NothingIsOn());
  double laser_s = 0, lamps_s = 0, torque_s = 0;
  for (const auto& [what, when] : ReadRig(*rig_).changed_s) {
    double& latest = what == "laser" ? laser_s : what.starts_with("torque") ? torque_s : lamps_s;
    latest = std::max(latest, when - killed_s);
  }
  std::printf("after kill -9: laser off in %.2f s, lamps in %.2f s, torque in %.2f s\n", laser_s,
              lamps_s, torque_s);
  EXPECT_LE(laser_s, 1.5) << "the one-shot";
  EXPECT_LE(lamps_s, 6) << "the bank's timeout";
  EXPECT_LE(torque_s, 6) << "the drives' heartbeat";
  EXPECT_EQ(Level(kEstop), "1\n") << "and nothing else did it";
  EXPECT_THAT(Shell("gpioget rig-lines 1"), HasSubstr("1")) << "the kernel has its lines back";
}

}  // namespace
}  // namespace mesorig::test
