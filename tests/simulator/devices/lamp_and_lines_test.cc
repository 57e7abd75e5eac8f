#include <gtest/gtest.h>
#include <modbus.h>

#include <cerrno>
#include <filesystem>
#include <thread>

#include "simulator/devices/digital_lines/digital_lines.h"
#include "simulator/devices/lamp_slave/lamp_bank_model.h"
#include "simulator/devices/lamp_slave/lamp_slave.h"
#include "tests/fixtures/small_rig.h"

namespace mesorig::simulator {
namespace {

using fixtures::SmallRig;
using std::chrono::milliseconds;
using std::chrono::seconds;

TEST(LampBankModel, CommunicationLossSwitchesOff) {
  const Rig rig = SmallRig();
  Contactor contactor;
  LampBankModel bank(rig, contactor);
  EXPECT_EQ(bank.NextEvent(), kNever) << "nothing to lose before the first request";
  bank.RequestSeen(seconds(1));
  bank.Switch(0, true, seconds(1));
  EXPECT_EQ(bank.FluxPerMille(0, milliseconds(1900)), 1000);
  EXPECT_EQ(bank.NextEvent(), RigTime(seconds(2)));
  sim_wire::Outbox out;
  bank.RunEvent(seconds(2), out);
  EXPECT_FALSE(bank.Coil(0));
  EXPECT_EQ(bank.FluxPerMille(0, seconds(5)), 0);
}

TEST(LampBankModel, ContactorCutsTheSupplyAndClosingDoesNotRestoreIt) {
  const Rig rig = SmallRig();
  Contactor contactor;
  LampBankModel bank(rig, contactor);
  DigitalLinesDevice lines(rig.lines, contactor);
  sim_wire::Outbox out;
  bank.Switch(2, true, seconds(1));
  EXPECT_EQ(bank.CommandedLevels(), (std::vector<double>{0, 1})) << "channel 2 is lamp L1";
  ASSERT_TRUE(lines.Inject(seconds(2), "door open", out).ok());
  EXPECT_EQ(bank.CommandedLevels(), (std::vector<double>{0, 0}));
  ASSERT_TRUE(lines.Inject(seconds(3), "door close", out).ok());
  EXPECT_FALSE(contactor.closed()) << "closing the chain never re-energises";
  bank.Switch(2, true, seconds(3));
  EXPECT_FALSE(bank.Coil(2)) << "no supply";
  ASSERT_TRUE(lines.Inject(seconds(4), "reset", out).ok());
  EXPECT_TRUE(contactor.closed());
  EXPECT_FALSE(bank.Coil(2));
}

TEST(DigitalLines, LevelsAndEdges) {
  const Rig rig = SmallRig();
  Contactor contactor;
  DigitalLinesDevice lines(rig.lines, contactor);
  sim_wire::Outbox out;
  const auto level = [&](int line) {
    return lines.Query({}, sim_wire::PackLineQuery(static_cast<uint16_t>(line)), out).value()[0];
  };
  EXPECT_EQ(level(0), 1);
  ASSERT_TRUE(lines.Inject({}, "estop open", out).ok());
  EXPECT_EQ(level(0), 0);
  const auto edges = out.Take();
  ASSERT_EQ(edges.size(), 2u) << "of the chain, then of the contactor";
  EXPECT_EQ(sim_wire::UnpackLineEdge(edges[0])->level, 0);
  EXPECT_EQ(sim_wire::UnpackLineEdge(edges[1])->line, rig.lines.power);
  EXPECT_EQ(sim_wire::UnpackLineEdge(edges[1])->level, 0);
  EXPECT_EQ(level(rig.lines.power), 0);
  EXPECT_FALSE(lines.Query({}, sim_wire::PackLineQuery(17), out).ok());
  EXPECT_FALSE(lines.Inject({}, "estop sideways", out).ok());
  ASSERT_TRUE(lines.Inject({}, "reset", out).ok());
  EXPECT_FALSE(contactor.closed()) << "the chain is still open";
}

// A real Modbus master against the slave's socket.
TEST(LampSlave, SpeaksModbusTcp) {
  const Rig rig = SmallRig();
  const auto path = std::filesystem::temp_directory_path() / fmt::format("mesorig-lamp-{}", getpid());
  std::filesystem::remove(path);
  Contactor contactor;
  LampBankModel bank(rig, contactor);
  sim_wire::SimServer server(sim_wire::Listen(path).value(), {&bank}, {});
  auto slave = LampSlave::Listen(bank, 1).value();
  slave->Start(server);
  const std::string& endpoint = slave->endpoint();
  modbus_t* master =
      modbus_new_tcp("127.0.0.1", std::stoi(endpoint.substr(endpoint.find(':') + 1)));
  modbus_set_slave(master, 1);
  ASSERT_EQ(modbus_connect(master), 0);
  ASSERT_EQ(modbus_write_bit(master, 2, 1), 1);
  uint8_t coils[3] = {9, 9, 9};
  ASSERT_EQ(modbus_read_bits(master, 0, 3, coils), 3);
  EXPECT_EQ(coils[0], 0);
  EXPECT_EQ(coils[2], 1);
  uint16_t flux[3] = {9, 9, 9};
  ASSERT_EQ(modbus_read_input_registers(master, 0, 3, flux), 3);
  EXPECT_EQ(flux[2], 0) << "no virtual time has passed";
  EXPECT_EQ(modbus_read_input_registers(master, 7, 1, flux), -1);
  EXPECT_EQ(errno, EMBXILADD);
  modbus_close(master);
  ASSERT_EQ(modbus_connect(master), 0) << "a master may come again";
  EXPECT_EQ(modbus_read_bits(master, 0, 3, coils), 3);
  modbus_close(master);
  modbus_free(master);
  slave.reset();
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace mesorig::simulator
