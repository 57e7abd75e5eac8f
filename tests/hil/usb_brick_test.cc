// The nxt_laser driver by libusb over the kernel's USB, with the simulated brick on the other side
// of the virtual host controller (USB/IP; mesorig-sim run and bridge, started by job.sh), in real
// time. lsusb is the witness.

#include <gmock/gmock.h>

#include "daemon/bus/libusb_port.h"
#include "daemon/drivers/driver.h"
#include "protocol/rig/rig.h"
#include "tests/hil/shell.h"

namespace mesorig::daemon {
namespace {

using hil::Eventually;
using hil::Shell;
using std::chrono::seconds;
using ::testing::HasSubstr;

const UsbKind kBrick{"NXT brick", 0x0694, 0x0002, 0x01, 0x82};
constexpr char kSerial[] = "0016530A1B2C";  // as job.sh has it

bool IsListed() { return Shell("lsusb -d 0694:0002").find("0694") != std::string::npos; }

void Plug() {
  Shell("usbip attach -r 127.0.0.1 -b 1-1");
  EXPECT_TRUE(Eventually(IsListed));
}

void Unplug() {
  Shell("usbip detach -p 0");
  EXPECT_TRUE(Eventually([] { return !IsListed(); }));
}

class UsbBrick : public ::testing::Test {
 protected:
  void SetUp() override {
    auto rig = LoadRig("/tmp/usb_rig.toml");
    ASSERT_TRUE(rig.ok()) << rig.status();
    rig_ = *std::move(rig);
    Plug();
    ASSERT_NO_FATAL_FAILURE(OpenPort(kSerial));
    context_.clock = &clock_;
    context_.rig = &rig_;
    context_.stop = &stop_;
    context_.usb = port_.get();
    auto laser = MakeLineLaser("nxt_laser", context_);
    ASSERT_TRUE(laser.ok()) << laser.status();
    laser_ = *std::move(laser);
  }
  void TearDown() override {
    if (laser_) (void)laser_->Stop();
    laser_.reset();
    port_.reset();
    Unplug();
  }
  void OpenPort(const std::string& serial) {
    auto port = LibusbPort::Open(clock_, kBrick, serial);
    ASSERT_TRUE(port.ok()) << port.status();
    port_ = *std::move(port);
  }

  SystemRigClock clock_;
  Rig rig_;
  StopFlag stop_{clock_};
  DriverContext context_;
  std::unique_ptr<LibusbPort> port_;
  std::unique_ptr<LineLaser> laser_;
  RigClock::Member member_{clock_, "test"};
};

TEST_F(UsbBrick, SweepsAndTheWitnessSeesTheSameDevice) {
  ASSERT_EQ(port_->Health(), OkStatus());
  ASSERT_EQ(laser_->Open(), OkStatus());
  ASSERT_EQ(laser_->MarkZero(), OkStatus());
  const double rate = RadFromDeg(0.5);
  ASSERT_EQ(laser_->Prepare(RadFromDeg(0.5), rate), OkStatus());
  ASSERT_TRUE(laser_->StartSweep(rate).ok());
  ASSERT_EQ(laser_->AwaitTilt(RadFromDeg(0.5), clock_.Now() + seconds(20)), OkStatus());
  const auto reading = laser_->Read();
  ASSERT_TRUE(reading.ok()) << reading.status();
  EXPECT_TRUE(reading->moving);
  EXPECT_GE(reading->tilt_rad, RadFromDeg(0.5));
  ASSERT_EQ(laser_->Stop(), OkStatus());
  EXPECT_EQ(port_->figures().sent, port_->figures().received) << "a reply to each telegram";
  const std::string seen = Shell("lsusb -v -d 0694:0002");
  EXPECT_THAT(seen, HasSubstr(kSerial));
  EXPECT_THAT(seen, HasSubstr("EP 1 OUT"));
  EXPECT_THAT(seen, HasSubstr("EP 2 IN"));
}

// The cable is pulled while the motor turns; plugged again, the same process goes on.
TEST_F(UsbBrick, IsUnpluggedWhileItTurnsAndComesBack) {
  ASSERT_EQ(laser_->Open(), OkStatus());
  ASSERT_TRUE(laser_->StartSweep(RadFromDeg(0.5)).ok());
  Unplug();
  ASSERT_TRUE(Eventually([&] { return !port_->Health().ok(); }));
  EXPECT_THAT(std::string(Message(port_->Health())), HasSubstr(kSerial));
  const auto lost = laser_->Read();
  EXPECT_TRUE(absl::IsUnavailable(lost.status())) << lost.status();
  EXPECT_THAT(std::string(Message(lost.status())), HasSubstr("laser "));
  Plug();
  ASSERT_TRUE(Eventually([&] { return port_->Health().ok(); })) << port_->Health();
  EXPECT_EQ(port_->figures().reconnects, 1u);
  EXPECT_EQ(laser_->Open(), OkStatus());
  EXPECT_TRUE(laser_->Read().ok());
}

TEST_F(UsbBrick, MayComeLaterAndIsKnownByItsSerialNumber) {
  laser_.reset();
  port_.reset();
  ASSERT_NO_FATAL_FAILURE(OpenPort("001653FFFFFF"));
  EXPECT_THAT(std::string(Message(port_->Health())),
              HasSubstr("not there; others of its kind: \"0016530A1B2C\""));
  EXPECT_TRUE(absl::IsUnavailable(port_->Write("x")));
  Unplug();
  port_.reset();
  ASSERT_NO_FATAL_FAILURE(OpenPort(kSerial));
  EXPECT_FALSE(port_->Health().ok());
  Plug();
  EXPECT_TRUE(Eventually([&] { return port_->Health().ok(); })) << port_->Health();
}

TEST_F(UsbBrick, IsOneProcessesOwn) {
  const auto second = LibusbPort::Open(clock_, kBrick, kSerial);
  EXPECT_TRUE(absl::IsFailedPrecondition(second.status())) << second.status();
  EXPECT_THAT(std::string(Message(second.status())), HasSubstr(std::to_string(::getpid())));
  EXPECT_TRUE(absl::IsInvalidArgument(port_->Write(std::string(65, 'x'))));
  EXPECT_TRUE(absl::IsInvalidArgument(port_->Write("")));
}

}  // namespace
}  // namespace mesorig::daemon
