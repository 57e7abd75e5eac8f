// The lamp driver and its bus against the simulator's Modbus slave (a libmodbus server).

#include "daemon/drivers/modbus_lamps/modbus_lamps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "tests/daemon/fakes/sim_rig.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon::modbus_lamps {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ModbusLampsTest : public ::testing::Test {
 protected:
  std::vector<double> Commanded() {
    std::vector<double> levels;
    sim_.Exclusive([&](RigTime) { levels = sim_.lamps.CommandedLevels(); });
    return levels;
  }
  const Rig rig_ = SmallRig();
  SimRig sim_{rig_};
  RigEnd end_{sim_, rig_};
  std::unique_ptr<daemon::LampBank> lamps_ = MakeLampBank("modbus_lamps", end_.context).value();
  RigClock::Member member_{*end_.link, "test"};
  RigClock::Activity activity_{*end_.link, Pace::kFree};
};

TEST_F(ModbusLampsTest, SwitchesOneAloneAndReadsItsLight) {
  ASSERT_EQ(lamps_->Open(), OkStatus());
  const RigTime then = end_.link->Now();
  ASSERT_EQ(lamps_->SwitchTo(2), OkStatus());  // channel 2 is lamp 1
  EXPECT_THAT(Commanded(), ElementsAre(0, 1));
  EXPECT_EQ(end_.link->Now(), then) << "a request takes no virtual time";
  end_.link->SleepFor(milliseconds(50));  // one time constant
  EXPECT_NEAR(lamps_->ReadLevels().value()[1], 1 - std::exp(-1.0), 0.001);
  end_.link->SleepFor(milliseconds(450));
  EXPECT_THAT(lamps_->ReadLevels().value(), ElementsAre(0, 1));
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  EXPECT_THAT(Commanded(), ElementsAre(1, 0));
  ASSERT_EQ(lamps_->AllOff(), OkStatus());
  EXPECT_THAT(Commanded(), ElementsAre(0, 0));
  EXPECT_TRUE(absl::IsInvalidArgument(lamps_->SwitchTo(3)));
}

TEST_F(ModbusLampsTest, KeepAliveOutlastsTheBanksTimeout) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  end_.link->SleepFor(seconds(30));  // a long move; the bank's timeout is 1 s
  EXPECT_THAT(Commanded(), ElementsAre(1, 0));
  EXPECT_THAT(lamps_->ReadLevels().value(), ElementsAre(1, 0));
}

TEST_F(ModbusLampsTest, OwnerThatFallsSilentLosesItsLamps) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  end_.link->SleepFor(std::chrono::minutes(2) + seconds(3));
  EXPECT_THAT(Commanded(), ElementsAre(0, 0));
}

TEST_F(ModbusLampsTest, AllOffFromAnyThread) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  std::thread other([&] { EXPECT_EQ(lamps_->AllOff(), OkStatus()); });
  other.join();
  EXPECT_THAT(Commanded(), ElementsAre(0, 0));
}

TEST_F(ModbusLampsTest, ManySwitchOffsAtATimeAllSucceed) {
  for (int round = 0; round < 20; ++round) {
    std::vector<std::thread> others;
    for (int i = 0; i < 4; ++i) {
      others.emplace_back([&] { EXPECT_EQ(lamps_->AllOff(), OkStatus()); });
    }
    // May be overtaken, and then says so; it never outlasts the last switch-off.
    const Status on = lamps_->SwitchTo(0);
    EXPECT_TRUE(on.ok() || absl::IsCancelled(on)) << on;
    for (std::thread& other : others) other.join();
    EXPECT_EQ(lamps_->AllOff(), OkStatus());
    EXPECT_THAT(Commanded(), ElementsAre(0, 0));
  }
}

TEST_F(ModbusLampsTest, DestructionSwitchesOff) {
  ASSERT_EQ(lamps_->SwitchTo(0), OkStatus());
  lamps_.reset();
  EXPECT_THAT(Commanded(), ElementsAre(0, 0));
}

TEST_F(ModbusLampsTest, SlavesExceptionIsTold) {
  const auto registers = end_.modbus->ReadInputRegisters(100, 2);
  EXPECT_TRUE(absl::IsUnavailable(registers.status()));
  EXPECT_THAT(std::string(Message(registers.status())),
              HasSubstr("reading input registers 100..101: Illegal data address"));
  EXPECT_EQ(lamps_->Open(), OkStatus()) << "the connection is good";
}

TEST_F(ModbusLampsTest, ABusOfTheRigFileOverTcpIsOneProcesss) {
  Buses::Modbus where;
  where.tcp = end_.modbus->endpoint();
  ModbusBusOptions options;
  options.unit = rig_.lamp_bank.unit;
  auto bus = ModbusBus::Open(*end_.link, where, options);
  ASSERT_TRUE(bus.ok()) << bus.status();
  EXPECT_EQ((*bus)->WriteCoils(0, {1, 0, 0}), OkStatus());
  EXPECT_THAT(Commanded(), ElementsAre(1, 0));
  const Status second = ModbusBus::Open(*end_.link, where, options).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
  EXPECT_THAT(std::string(Message(second)),
              HasSubstr(fmt::format("tcp:{} is in use by process {}", where.tcp, ::getpid())));
}

TEST_F(ModbusLampsTest, BadEndpointsAreRefused) {
  for (const char* endpoint : {"", "127.0.0.1", "127.0.0.1:", ":502", "127.0.0.1:70000", "a:b:c"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(ModbusBus::Connect(*end_.link, endpoint, {}).status()))
        << endpoint;
  }
  EXPECT_TRUE(absl::IsUnavailable(ModbusBus::Connect(*end_.link, "127.0.0.1:1", {}).status()));
}

}  // namespace
}  // namespace mesorig::daemon::modbus_lamps
