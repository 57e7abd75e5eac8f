// ModbusBus over a serial line: a pseudo-terminal with a slave that is not libmodbus.

#include <gmock/gmock.h>

#include <random>

#include "daemon/bus/modbus_bus.h"
#include "tests/daemon/fakes/pty_slave.h"

namespace mesorig::daemon {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class ModbusRtu : public ::testing::Test {
 protected:
  void Open(milliseconds response_timeout = milliseconds(1000)) {
    ModbusBusOptions options;
    options.unit = 5;
    options.response_timeout = response_timeout;
    auto bus = ModbusBus::Open(clock_, Where(), options);
    ASSERT_TRUE(bus.ok()) << bus.status();
    bus_ = *std::move(bus);
  }
  Buses::Modbus Where() const {
    Buses::Modbus where;
    where.rtu = slave_.device();
    return where;
  }
  std::string ErrorOf(const Status& status) {
    EXPECT_TRUE(absl::IsUnavailable(status)) << status;
    return std::string(Message(status));
  }

  SystemRigClock clock_;
  PtySlave slave_{5};
  std::unique_ptr<ModbusBus> bus_;
  RigClock::Member member_{clock_, "test"};
};

TEST_F(ModbusRtu, WritesAndReads) {
  ASSERT_NO_FATAL_FAILURE(Open());
  ASSERT_EQ(bus_->WriteCoils(0, {0, 1, 0, 0, 0, 0, 0, 0, 0, 1}), OkStatus());
  EXPECT_TRUE(slave_.coils()[1] && slave_.coils()[9]);
  EXPECT_THAT(bus_->ReadInputRegisters(0, 3).value(), ElementsAre(0, 1000, 0));
  ASSERT_EQ(bus_->WriteCoilsAtOnce(0, std::vector<uint8_t>(10)), OkStatus());
  EXPECT_FALSE(slave_.coils()[1] || slave_.coils()[9]);
  EXPECT_EQ(slave_.damaged(), 0);
}

TEST_F(ModbusRtu, ExceptionsDamageAndSilenceAreToldApart) {
  ASSERT_NO_FATAL_FAILURE(Open(milliseconds(50)));
  EXPECT_THAT(ErrorOf(bus_->ReadInputRegisters(100, 1).status()), HasSubstr("Illegal data address"));
  EXPECT_EQ(bus_->counts().refused, 1u);
  EXPECT_EQ(bus_->counts().connections, 0u) << "the line is good";
  slave_.Meddle([](std::string answer) {
    answer.back() = static_cast<char>(answer.back() ^ 0x40);
    return answer;
  });
  EXPECT_THAT(ErrorOf(bus_->ReadInputRegisters(0, 2).status()), HasSubstr("Invalid CRC"));
  EXPECT_EQ(bus_->counts().damaged, 2u) << "asked again once";
  EXPECT_EQ(bus_->counts().unanswered, 0u);
  slave_.Meddle([](const std::string&) { return std::string(); });
  EXPECT_THAT(ErrorOf(bus_->ReadInputRegisters(0, 2).status()), HasSubstr("timed out"));
  EXPECT_EQ(bus_->counts().unanswered, 2u);
  slave_.Meddle(nullptr);
  EXPECT_TRUE(bus_->ReadInputRegisters(0, 2).ok());
  EXPECT_EQ(bus_->counts().broken, 0u);
}

TEST_F(ModbusRtu, AnotherUnitsAnswerIsNone) {
  ASSERT_NO_FATAL_FAILURE(Open(milliseconds(50)));
  slave_.Meddle([](std::string answer) {
    answer[0] = 6;
    return WithCrc(answer.substr(0, answer.size() - 2));
  });
  EXPECT_FALSE(bus_->ReadInputRegisters(0, 2).ok());
  EXPECT_EQ(bus_->counts().damaged, 2u);
}

TEST_F(ModbusRtu, ALineThatWasHungUpComesBack) {
  ASSERT_NO_FATAL_FAILURE(Open());
  ASSERT_EQ(bus_->WriteCoils(0, {1, 0}), OkStatus());
  slave_.HangUp();
  ErrorOf(bus_->WriteCoils(0, {0, 1}));
  EXPECT_THAT(ErrorOf(bus_->WriteCoilsAtOnce(0, {0, 0})), HasSubstr("No such file"));
  EXPECT_GE(bus_->counts().broken, 2u);
  slave_.PlugIn();
  ASSERT_EQ(bus_->WriteCoils(0, {0, 1}), OkStatus());
  EXPECT_TRUE(slave_.coils()[1]);
  EXPECT_GE(bus_->counts().connections, 1u);
}

TEST_F(ModbusRtu, OneProcessHasALine) {
  ASSERT_NO_FATAL_FAILURE(Open());
  const Status second = ModbusBus::Open(clock_, Where(), {}).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
  EXPECT_THAT(std::string(Message(second)), HasSubstr(fmt::format("in use by process {}", ::getpid())));
  bus_.reset();
  ASSERT_NO_FATAL_FAILURE(Open());
}

TEST_F(ModbusRtu, ALineThatIsNotThere) {
  Buses::Modbus where;
  where.rtu = "/dev/mesorig-no-such-line";
  const Status none = ModbusBus::Open(clock_, where, {}).status();
  EXPECT_TRUE(absl::IsUnavailable(none));
  EXPECT_THAT(std::string(Message(none)), HasSubstr("rtu:/dev/mesorig-no-such-line"));
}

// Whatever comes over the line: an error, or what the slave meant; with a good checksum under a lie,
// an error or a lie, and coils are never said to be written when they read otherwise.
TEST_F(ModbusRtu, SurvivesMutations) {
  ASSERT_NO_FATAL_FAILURE(Open(milliseconds(5)));
  std::mt19937 random(20050101);
  std::atomic<bool> lies{false};
  slave_.Meddle([&](std::string answer) {
    lies = random() % 2 == 0;
    if (lies) answer.resize(answer.size() - 2);
    for (int edits = 1 + static_cast<int>(random() % 3); edits > 0; --edits) {
      const size_t at = random() % (answer.size() + 1);
      switch (random() % 5) {
        case 0: answer.resize(at); break;
        case 1: answer.insert(at, std::string(random() % 300, '\xFF')); break;
        case 2: answer.insert(at, answer.substr(0, at)); break;
        default:
          if (at < answer.size()) answer[at] = static_cast<char>(random() % 256);
      }
    }
    return lies ? WithCrc(answer) : answer;
  });
  int errors = 0;
  for (int i = 0; i < 300; ++i) {
    const bool on = i % 2 == 0;
    const Status written = bus_->WriteCoils(0, {on, !on, 0});
    const auto read = bus_->ReadInputRegisters(0, 3);
    errors += !written.ok() + !read.ok();
    if (read.ok()) {
      ASSERT_EQ(read->size(), 3u);
      if (!lies && written.ok()) {
        ASSERT_THAT(*read, ElementsAre(on ? 1000 : 0, on ? 0 : 1000, 0)) << i;
      }
    }
  }
  EXPECT_GT(errors, 300);
  EXPECT_GT(bus_->counts().damaged, 50u);
  slave_.Meddle(nullptr);
  bool well = false;  // (a busy machine may take longer than those 5 ms)
  for (int i = 0; i < 1000 && !well; ++i) well = bus_->WriteCoils(0, {1, 0, 0}).ok();
  EXPECT_TRUE(well) << "it does not go on";
}

}  // namespace
}  // namespace mesorig::daemon
