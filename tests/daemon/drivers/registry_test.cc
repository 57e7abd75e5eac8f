// The contract of the registry: holds for each driver without a test of its own.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using ::testing::HasSubstr;

Status Make(const Driver& driver, const DriverContext& context) {
  if (driver.make_axis != nullptr) return driver.make_axis(context, 0).status();
  if (driver.make_lamp_bank != nullptr) return driver.make_lamp_bank(context).status();
  if (driver.make_lines != nullptr) return driver.make_lines(context).status();
  if (driver.make_laser != nullptr) return driver.make_laser(context).status();
  return driver.make_camera(context, 0).status();
}

class CountingUsb final : public UsbPort {
 public:
  int writes = 0;
  Status Write(std::string_view) override {
    ++writes;
    return OkStatus();
  }
  void OnPacket(std::function<void(RigTime, std::string)>) override {}
};

TEST(DriverRegistry, NamesAreUniqueAndEachDrivesOneKind) {
  std::set<std::string_view> names;
  for (const Driver& driver : AllDrivers()) {
    EXPECT_FALSE(driver.name.empty());
    EXPECT_TRUE(names.insert(driver.name).second) << driver.name;
    const int kinds = (driver.make_axis != nullptr) + (driver.make_lamp_bank != nullptr) +
                      (driver.make_lines != nullptr) + (driver.make_camera != nullptr) +
                      (driver.make_laser != nullptr);
    EXPECT_EQ(kinds, 1) << driver.name;
  }
  EXPECT_TRUE(names.contains("cia402"));
}

TEST(DriverRegistry, MakesDevicesWithoutTalkingToAnybody) {
  const Rig rig = SmallLaserRig();
  SimRig sim(rig);
  RigEnd end(sim, rig);
  RigClock::Member member(*end.link, "test");
  CountingUsb usb;
  end.context.usb = &usb;
  for (const Driver& driver : AllDrivers()) {
    EXPECT_EQ(Make(driver, end.context), OkStatus()) << driver.name;
  }
  EXPECT_EQ(sim.can.commands, 0);
  EXPECT_EQ(usb.writes, 0);
}

TEST(DriverRegistry, SaysWhichBusIsMissing) {
  const Rig rig = SmallLaserRig();
  SystemRigClock clock;
  StopFlag stop(clock);
  DriverContext context;
  context.clock = &clock;
  context.rig = &rig;
  context.stop = &stop;
  for (const Driver& driver : AllDrivers()) {
    const Status status = Make(driver, context);
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << driver.name << ": " << status;
    EXPECT_THAT(std::string(Message(status)), HasSubstr(std::string(driver.name)));
  }
}

TEST(DriverRegistry, UnknownNamesListTheKnownOnes) {
  const Status status = MakeAxis("modbus_lamps", {}, 0).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_THAT(std::string(Message(status)), HasSubstr("there are: cia402"));
}

// What the contracts say of devices before they are enabled or opened.
TEST(DriverRegistry, AxesRefuseToMoveBeforeTheyAreEnabled) {
  const Rig rig = SmallRig();
  SimRig sim(rig);
  RigEnd end(sim, rig);
  RigClock::Member member(*end.link, "test");
  RigClock::Activity activity(*end.link, Pace::kFree);
  for (const Driver& driver : AllDrivers()) {
    if (driver.make_axis == nullptr) continue;
    auto axis = driver.make_axis(end.context, 0).value();
    EXPECT_EQ(axis->name(), rig.axes[0].name);
    EXPECT_TRUE(absl::IsFailedPrecondition(axis->StartMove(0)));
    EXPECT_TRUE(absl::IsFailedPrecondition(axis->StartHoming()));
    EXPECT_EQ(axis->QuickStop(), OkStatus());
    EXPECT_EQ(axis->Disable(), OkStatus());
    EXPECT_FALSE(axis->Read().enabled);
    EXPECT_FALSE(axis->Read().referenced);
  }
}

TEST(DriverRegistry, LinesReadLevels) {
  const Rig rig = SmallRig();
  SimRig sim(rig);
  RigEnd end(sim, rig);
  for (const Driver& driver : AllDrivers()) {
    if (driver.make_lines == nullptr) continue;
    auto lines = driver.make_lines(end.context).value();
    EXPECT_TRUE(lines->Read(rig.lines.door).value());
    sim_wire::Outbox out;
    sim.Exclusive([&](RigTime now) { EXPECT_TRUE(sim.lines.Inject(now, "door open", out).ok()); });
    EXPECT_FALSE(lines->Read(rig.lines.door).value());
    EXPECT_TRUE(lines->Read(rig.lines.estop).value());
    EXPECT_FALSE(lines->Read(99).ok());
    sim.Exclusive([&](RigTime now) { EXPECT_TRUE(sim.lines.Inject(now, "door close", out).ok()); });
  }
}

}  // namespace
}  // namespace mesorig::daemon
