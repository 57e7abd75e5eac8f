#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "protocol/base/file_writer.h"
#include "protocol/rig/rig.h"

namespace mesorig {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string DemoText() {
  return ReadFile(std::string(MESORIG_SOURCE_DIR) + "/rigs/demo.toml").value();
}

// The demo rig with the first `from` replaced by `to`.
std::string With(std::string_view from, std::string_view to) {
  std::string text = DemoText();
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

constexpr std::string_view kBuses = R"(
[buses.can]
interface = "can0"
bitrate = 500000
[buses.gpio]
chip = "rig-lines"
[buses.gpio.names]
estop = "E-STOP"
laser_trigger = "LASER"
[buses.modbus]
rtu = "/dev/ttyUSB0"
baud = 38400
parity = "none"
[buses.usb]
serial = "001653012345"
)";

// The demo rig on real buses, with the first `from` of theirs replaced by `to`.
std::string WithBuses(std::string_view from = "", std::string_view to = "") {
  std::string buses(kBuses);
  const size_t at = buses.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return DemoText() + buses.replace(at, from.size(), to);
}

std::string ErrorOf(const std::string& text) {
  const StatusOr<Rig> rig = ParseRig(text, "rig.toml");
  EXPECT_FALSE(rig.ok());
  if (rig.ok()) return "";
  EXPECT_EQ(rig.status().code(), absl::StatusCode::kInvalidArgument) << rig.status();
  return std::string(rig.status().message());
}

// "rig.toml:LINE:" of the first place where `text` stands in the given rig.
std::string LineOf(const std::string& rig, std::string_view text) {
  const size_t at = rig.find(text);
  return fmt::format("rig.toml:{}:", 1 + std::count(rig.begin(), rig.begin() + at, '\n'));
}

TEST(RigToml, UnknownKeyIsRefusedWithLineAndColumn) {
  const std::string text = With("settle_s = 0.6", "settle_s = 0.6\n  colour = \"red\"");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr(LineOf(text, "colour") + "3"), HasSubstr("colour")));
}

TEST(RigToml, UnknownTableIsRefused) {
  EXPECT_THAT(ErrorOf(DemoText() + "\n[kaleidoscope]\nmirrors = 3\n"), HasSubstr("kaleidoscope"));
}

TEST(RigToml, TwoLampsOnOneChannel) {
  const std::string text = With("channel = 3", "channel = 2");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("rig.toml:"), HasSubstr("channel"), HasSubstr("2")));
}

TEST(RigToml, ALaserNeedsItsLinesOfTheInterlock) {
  for (const char* line : {"laser_trigger = 3", "laser_on = 4", "estop = 0", "door = 1"}) {
    const std::string text = With(line, "");
    EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr(LineOf(text, "[lines]")), HasSubstr("is missing")));
  }
}

TEST(RigToml, MainsAndRestAreOptional) {
  const Rig rig = ParseRig(With("mains_hz = 50", "mains_hz = 60"), "rig.toml").value();
  EXPECT_EQ(rig.mains_hz, 60);
  EXPECT_EQ(rig.axes[0].settle_s, 0);
  EXPECT_EQ(ParseRig(With("mains_hz = 50", ""), "rig.toml")->mains_hz, 0);
  EXPECT_EQ(ParseRig(With("can_node = 2", "can_node = 2\nsettle_s = 0.3"), "rig.toml")->axes[1].settle_s,
            0.3);
  EXPECT_THAT(ErrorOf(With("mains_hz = 50", "mains_hz = 0")), HasSubstr("mains_hz"));
}

TEST(RigToml, TwoAxesOnOneNode) {
  EXPECT_THAT(ErrorOf(With("can_node = 2", "can_node = 1")), HasSubstr("can_node"));
}

TEST(RigToml, TwoCamerasOfOneSerial) {
  EXPECT_THAT(ErrorOf(With("DF256-02", "DF256-01")), HasSubstr("DF256-01"));
}

TEST(RigToml, TwoInputsOnOneLine) {
  EXPECT_THAT(ErrorOf(With("door = 1", "door = 0")), HasSubstr("door"));
}

TEST(RigToml, NotANumber) {
  for (const char* value : {"nan", "inf", "-inf", "+nan"}) {
    const std::string text = With("distance_mm = 650", fmt::format("distance_mm = {}", value));
    EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr(LineOf(text, "distance_mm")),
                                     HasSubstr("distance_mm")));
  }
}

TEST(RigToml, WrongType) {
  const std::string text = With("width_px = 256", "width_px = \"256\"");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr(LineOf(text, "width_px")), HasSubstr("width_px")));
}

TEST(RigToml, OutOfRangeNamesValueAndRange) {
  const std::string text = With("bits = 12", "bits = 16");
  EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr("bits"), HasSubstr("16"), HasSubstr("12")));
  EXPECT_THAT(ErrorOf(With("bits = 12", "bits = 10")), HasSubstr("bits"));
}

TEST(RigToml, MissingKey) {
  EXPECT_THAT(ErrorOf(With("focal_px = 2600\n", "")), HasSubstr("focal_px"));
}

TEST(RigToml, UndefinedNames) {
  EXPECT_THAT(ErrorOf(With("axis = \"turntable\"", "axis = \"tilt\"")), HasSubstr("tilt"));
  EXPECT_THAT(ErrorOf(With("frame = \"light_arc\"", "frame = \"dome\"")), HasSubstr("dome"));
}

TEST(RigToml, SampleFrameIsNeeded) {
  EXPECT_THAT(ErrorOf(With("name = \"sample\"", "name = \"plate\"")), HasSubstr("sample"));
}

TEST(RigToml, WorldCannotBeDefined) {
  EXPECT_THAT(ErrorOf(With("name = \"camera_arc\"", "name = \"world\"")), HasSubstr("world"));
}

TEST(RigToml, LaserIsRead) {
  const Rig rig = ParseRig(DemoText(), "rig.toml").value();
  ASSERT_TRUE(rig.laser);
  EXPECT_NEAR(DegFromRad(rig.laser->backlash_rad), 30, 1e-9);
  EXPECT_NEAR(DegFromRad(rig.laser->mounts.at(1).theta_rad), 35, 1e-9);
  EXPECT_EQ(rig.lines.laser_trigger, 3);
  EXPECT_EQ(rig.lines.laser_on, 4);
  EXPECT_EQ(rig.turntable->radius_mm, 60);
}

TEST(RigToml, LaserMistakesAreNamed) {
  EXPECT_THAT(ErrorOf(With("laser_on = 4", "laser_on = 3")), HasSubstr("laser_on"));
  EXPECT_THAT(ErrorOf(With("laser_on = 4", "")), HasSubstr("laser_on"));
  EXPECT_THAT(ErrorOf(With("name = \"slant\"", "name = \"zenith\"")), HasSubstr("zenith"));
  EXPECT_THAT(ErrorOf(With("theta_deg = 35", "theta_deg = 85")), HasSubstr("max_tilt_deg"));
  EXPECT_THAT(ErrorOf(With("response = [0.15, 1.0, 0.1]", "response = [0, 0, 0]")),
              HasSubstr("response"));
  EXPECT_THAT(ErrorOf(With("[turntable]\nradius_mm = 60\nalbedo = 0.3", "")),
              HasSubstr("turntable"));
  EXPECT_THAT(ErrorOf(With("motor_port = 0", "motor_port = 3")), HasSubstr("motor_port"));
}

TEST(RigToml, LimitsInOrder) {
  EXPECT_THAT(ErrorOf(With("min_deg = -10", "min_deg = 370")), HasSubstr("max_deg"));
  EXPECT_THAT(ErrorOf(With("min_exposure_s = 0.0001", "min_exposure_s = 0.6")),
              HasSubstr("max_exposure_s"));
}

TEST(RigToml, ALimitOfTemperaturesNeedsThem) {
  const std::string said = ErrorOf(With("housing_temperatures = true", ""));
  EXPECT_THAT(said, HasSubstr("max_housing_c"));
  EXPECT_THAT(said, HasSubstr("housing_temperatures = true"));
  EXPECT_EQ(said, ErrorOf(With("housing_temperatures = true", "housing_temperatures = false")));
  const auto unlimited = ParseRig(With("max_housing_c = 200", ""), "rig.toml");
  ASSERT_TRUE(unlimited.ok()) << unlimited.status();
  EXPECT_TRUE(unlimited->lamp_bank.housing_temperatures);
  EXPECT_EQ(unlimited->lamp_bank.max_housing_c, 0);
}

TEST(RigToml, ARigWithoutBusesIsTheSimulators) {
  EXPECT_FALSE(ParseRig(DemoText(), "rig.toml")->buses.any());
}

TEST(RigToml, BusesAreRead) {
  const Rig rig = ParseRig(WithBuses(), "rig.toml").value();
  ASSERT_TRUE(rig.buses.can && rig.buses.gpio && rig.buses.modbus && rig.buses.usb);
  EXPECT_EQ(rig.buses.can->interface, "can0");
  EXPECT_EQ(rig.buses.can->bitrate, 500000);
  EXPECT_EQ(rig.buses.gpio->chip, "rig-lines");
  EXPECT_EQ(rig.buses.gpio->names, (std::map<int, std::string>{{0, "E-STOP"}, {3, "LASER"}}));
  EXPECT_EQ(rig.buses.modbus->endpoint(), "rtu:/dev/ttyUSB0");
  EXPECT_EQ(rig.buses.modbus->baud, 38400);
  EXPECT_EQ(rig.buses.modbus->parity, 'N');
  EXPECT_EQ(rig.buses.modbus->stop_bits, 2) << "a character has eleven bits";
  EXPECT_EQ(rig.buses.usb->serial, "001653012345");
  const Rig even = ParseRig(WithBuses("parity = \"none\"", ""), "rig.toml").value();
  EXPECT_EQ(even.buses.modbus->parity, 'E');
  EXPECT_EQ(even.buses.modbus->stop_bits, 1);
  const Rig tcp = ParseRig(DemoText() + "[buses.modbus]\ntcp = \"192.168.1.20:502\"\n", "rig.toml").value();
  EXPECT_EQ(tcp.buses.modbus->endpoint(), "tcp:192.168.1.20:502");
  EXPECT_FALSE(tcp.buses.can);
}

TEST(RigToml, MistakesInBusesAreNamed) {
  const std::pair<std::string_view, std::string_view> wrong[] = {
      {"interface = \"can0\"", "interface = \"a name of many words\""},
      {"interface = \"can0\"", "interface = \"\""},
      {"bitrate = 500000", "bitrate = 500"},
      {"chip = \"rig-lines\"", "chip = 3"},
      {"laser_trigger = \"LASER\"", "laser_trigger = \"E-STOP\""},
      {"rtu = \"/dev/ttyUSB0\"", "rtu = \"ttyUSB0\""},
      {"baud = 38400", "baud = 38401"},
      {"parity = \"none\"", "parity = \"mark\""},
      {"serial = \"001653012345\"", "serial = \"\""},
  };
  for (const auto& [from, to] : wrong) {
    const std::string text = WithBuses(from, to);
    const std::string key(to.substr(0, to.find(' ')));
    EXPECT_THAT(ErrorOf(text), AllOf(HasSubstr(LineOf(text, to)), HasSubstr(key))) << to;
  }
  EXPECT_THAT(ErrorOf(WithBuses("rtu =", "tcp = \"1.2.3.4:502\"\nrtu =")), HasSubstr("`rtu`"));
  EXPECT_THAT(ErrorOf(WithBuses("rtu = \"/dev/ttyUSB0\"", "")), HasSubstr("`tcp`"));
  for (const char* endpoint : {"1.2.3.4", ":502", "1.2.3.4:", "1.2.3.4:70000", "1.2.3.4:x"}) {
    EXPECT_THAT(ErrorOf(DemoText() + fmt::format("[buses.modbus]\ntcp = \"{}\"\n", endpoint)),
                HasSubstr("tcp"));
  }
  EXPECT_THAT(ErrorOf(WithBuses("estop =", "trapdoor =")), HasSubstr("trapdoor"));
  // A line that the rig does not have.
  std::string text = WithBuses("estop =", "power =");
  text.replace(text.find("power = 5"), 9, "");
  EXPECT_THAT(ErrorOf(text), HasSubstr("no line of this rig"));
}

TEST(RigToml, MissingFileIsNamed) {
  const StatusOr<Rig> rig = LoadRig("/nowhere/rig.toml");
  ASSERT_FALSE(rig.ok());
  EXPECT_EQ(rig.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(rig.status().message()), HasSubstr("/nowhere/rig.toml"));
}

// Whatever stands in the file, the parser answers; what it accepts has no NaN in its geometry.
TEST(RigToml, SurvivesMutations) {
  const std::string original = WithBuses();
  std::mt19937 random(20050101);
  int accepted = 0;
  for (int n = 0; n < 3000; ++n) {
    std::string text = original;
    const int edits = 1 + static_cast<int>(random() % 4);
    for (int e = 0; e < edits; ++e) {
      const size_t at = random() % text.size();
      switch (random() % 5) {
        case 0: text[at] = static_cast<char>(random() % 256); break;
        case 1: text.erase(at, 1 + random() % 20); break;
        case 2: text.insert(at, text.substr(random() % text.size(), random() % 40)); break;
        case 3: text[at] = "0123456789.-e\"[]=\n"[random() % 18]; break;
        default: text.resize(at + 1); break;
      }
      if (text.empty()) text = "x";
    }
    const StatusOr<Rig> rig = ParseRig(text, "mutant.toml");
    if (!rig.ok()) {
      ASSERT_EQ(rig.status().code(), absl::StatusCode::kInvalidArgument);
      continue;
    }
    ++accepted;
    for (const Lamp& lamp : rig->lamps) ASSERT_TRUE(std::isfinite(Norm(lamp.p_in_frame)));
    for (const Camera& camera : rig->cameras) {
      ASSERT_TRUE(std::isfinite(Norm(camera.frame_from_camera.translation)));
      ASSERT_GT(camera.focal_px, 0);
    }
  }
  EXPECT_GT(accepted, 0);
}

}  // namespace
}  // namespace mesorig
