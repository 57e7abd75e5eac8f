#include "simulator/devices/rig_log.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "protocol/base/file_writer.h"
#include "simulator/devices/cia402_node/can_bus.h"

namespace mesorig::simulator {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

std::filesystem::path LogPath() {
  return std::filesystem::temp_directory_path() / fmt::format("mesorig-log-{}.tsv", ::getpid());
}

TEST(RigLog, OneLineAnEventThreeColumns) {
  const auto log = RigLog::Create(LogPath()).value();
  log->Write({}, "laser", "off");
  log->Write(milliseconds(1250), "laser", "on");
  log->Write(seconds(61) + RigTime(7), "axis turntable", "moves");
  EXPECT_EQ(ReadFile(LogPath()).value(),
            "time_s\twhat\tevent\n"
            "0.000000000\tlaser\toff\n"
            "1.250000000\tlaser\ton\n"
            "61.000000007\taxis turntable\tmoves\n")
      << "flushed line by line";
  std::filesystem::remove(LogPath());
}

TEST(RigLog, NamesAFileThatItCannotWrite) {
  const auto log = RigLog::Create("/nowhere/rig.tsv");
  ASSERT_FALSE(log.ok());
  EXPECT_NE(log.status().message().find("/nowhere/rig.tsv"), std::string::npos);
}

// What the log hears of axes: one `moves` and one `stands` a homing, of both legs together, and
// again when the contactor takes the torque away in the middle of a move.
TEST(RigLog, AxesSayWhenTheyMoveAndStand) {
  const Rig rig = LoadRig(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value();
  Contactor contactor;
  CanBusDevice bus(rig, 3, contactor);
  sim_wire::Outbox out;
  std::vector<std::pair<bool, RigTime>> heard;
  bus.OnMotion([&](size_t axis, bool moves, RigTime now) {
    EXPECT_EQ(axis, 0u);
    EXPECT_EQ(bus.node(axis).Moving(now), moves);
    heard.emplace_back(moves, now);
  });
  RigTime now{};
  const auto send = [&](uint16_t id, uint8_t size, std::array<uint8_t, 8> data) {
    bus.Command(now, sim_wire::Pack(sim_wire::CanFrame{id, size, data}), out);
  };
  const auto run_until = [&](RigTime end) {
    while (bus.NextEvent() <= end) bus.RunEvent(bus.NextEvent(), out);
    now = end;
  };
  send(0x000, 2, {0x01, 0x01});              // node 1: operational
  send(0x601, 8, {0x2F, 0x60, 0x60, 0, 6});  // homing
  for (int word : {0x06, 0x07, 0x0F, 0x1F}) send(0x401, 6, {static_cast<uint8_t>(word)});
  run_until(seconds(100));
  ASSERT_EQ(heard.size(), 2u);
  EXPECT_TRUE(heard[0].first);
  EXPECT_FALSE(heard[1].first);
  EXPECT_LT(heard[1].second, RigTime(seconds(10)));
  send(0x601, 8, {0x2F, 0x60, 0x60, 0, 1});  // to 90 degrees
  send(0x401, 6, {0x0F});
  send(0x401, 6, {0x1F, 0, 0x90, 0x5F, 0x01});
  run_until(now + milliseconds(500));
  contactor.SetChain(false, now);
  ASSERT_EQ(heard.size(), 4u);
  EXPECT_TRUE(heard[2].first);
  EXPECT_FALSE(heard[3].first);
  EXPECT_EQ(heard[3].second, RigTime(seconds(100) + milliseconds(500)));
}

}  // namespace
}  // namespace mesorig::simulator
