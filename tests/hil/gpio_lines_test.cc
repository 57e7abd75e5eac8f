// GpioLinePort against the kernel: a chip of gpio-sim, whose inputs are pulled through sysfs, with
// libgpiod's own programs as witnesses. (An output of gpio-sim cannot be polled: its toggles here are
// as long as a witness takes to look.)

#include <gmock/gmock.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <thread>
#include <vector>

#include "daemon/bus/gpio_line_port.h"
#include "protocol/base/file_writer.h"
#include "tests/hil/shell.h"

namespace mesorig::daemon {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;
using hil::Eventually;
using hil::Shell;

constexpr const char* kLabel = "rig-lines";
constexpr int kEstop = 0, kDoor = 1, kTrigger = 3;

class GpioLines : public ::testing::Test {
 protected:
  void SetUp() override {
    FindChip();
    Pull(kEstop, true);
    Pull(kDoor, true);
    ASSERT_NO_FATAL_FAILURE(Open());
  }
  // A chip that comes back has another number, and the same label.
  void FindChip() {
    chip_ = Shell("cat /sys/kernel/config/gpio-sim/rig/bank0/chip_name");
    chip_.resize(chip_.find('\n'));
    device_ = Shell("cat /sys/kernel/config/gpio-sim/rig/dev_name");
    device_.resize(device_.find('\n'));
  }
  void Open() {
    GpioLineOptions options;
    options.chip = kLabel;
    options.inputs = {kEstop, kDoor};
    options.outputs = {kTrigger};
    auto port = GpioLinePort::Open(clock_, options);
    ASSERT_TRUE(port.ok()) << port.status();
    port_ = *std::move(port);
    port_->OnEdge([this](int line, bool level, RigTime) { edges_.emplace_back(line, level); });
  }
  std::string SysfsOf(int line, const std::string& what) const {
    return fmt::format("/sys/devices/platform/{}/{}/sim_gpio{}/{}", device_, chip_, line, what);
  }
  void Pull(int line, bool up) const {
    const std::string path = SysfsOf(line, "pull");
    FILE* const file = std::fopen(path.c_str(), "w");
    ASSERT_NE(file, nullptr) << path;
    std::fputs(up ? "pull-up" : "pull-down", file);
    std::fclose(file);
  }
  bool Level(int line) {
    const auto level = port_->Read(line);
    EXPECT_TRUE(level.ok()) << level.status();
    return level.value_or(false);
  }
  std::vector<std::pair<int, bool>> Edges() {
    std::vector<std::pair<int, bool>> edges;
    clock_.Read([&] { edges = edges_; });
    return edges;
  }

  SystemRigClock clock_;
  std::string chip_, device_;
  std::vector<std::pair<int, bool>> edges_;  // guarded by the clock's lock
  std::unique_ptr<GpioLinePort> port_;
};

TEST_F(GpioLines, LevelsAreThoseOfTheChip) {
  EXPECT_TRUE(Level(kDoor));
  Pull(kDoor, false);
  EXPECT_FALSE(Level(kDoor));
  EXPECT_TRUE(Level(kEstop));
  EXPECT_TRUE(absl::IsInvalidArgument(port_->Read(5).status())) << "nobody asked for it";
  EXPECT_TRUE(absl::IsInvalidArgument(port_->Read(-1).status()));
}

TEST_F(GpioLines, AnOpeningIsToldAtOnceAndAClosingWhenItStays) {
  Pull(kDoor, false);
  ASSERT_TRUE(Eventually([&] { return Edges().size() == 1; }));
  Pull(kDoor, true);
  ASSERT_TRUE(Eventually([&] { return Edges().size() == 2; }));
  EXPECT_THAT(Edges(), ElementsAre(Pair(kDoor, false), Pair(kDoor, true)));
}

TEST_F(GpioLines, ABouncingContactClosesOnce) {
  Pull(kEstop, false);
  ASSERT_TRUE(Eventually([&] { return Edges().size() == 1; }));
  for (int i = 0; i < 20; ++i) {  // (some of these are shorter than the simulated chip sees)
    Pull(kEstop, true);
    Pull(kEstop, false);
  }
  Pull(kEstop, true);
  ASSERT_TRUE(Eventually([&] { return Edges().back().second; }));
  // In a slow guest a bounce may be long enough to be a closing; the first and the last word are right.
  const auto edges = Edges();
  EXPECT_THAT(edges.front(), Pair(kEstop, false));
  for (size_t i = 1; i < edges.size(); ++i) EXPECT_NE(edges[i].second, edges[i - 1].second);
  EXPECT_TRUE(Level(kEstop));
}

TEST_F(GpioLines, AnOutputIsSeenByTheKernel) {
  EXPECT_THAT(Shell("cat " + SysfsOf(kTrigger, "value")), HasSubstr("0"));
  ASSERT_EQ(port_->Write(kTrigger, true), OkStatus());
  EXPECT_THAT(Shell("cat " + SysfsOf(kTrigger, "value")), HasSubstr("1"));
  ASSERT_EQ(port_->Write(kTrigger, false), OkStatus());
  EXPECT_THAT(Shell("cat " + SysfsOf(kTrigger, "value")), HasSubstr("0"));
}

// A one-shot sees microseconds; who looks now and then, 20 ms.
TEST_F(GpioLines, AShortPulseIsLongEnoughToBeSeen) {
  std::atomic<int> high{0};
  std::atomic<bool> ending{false};
  std::thread sampler([&] {
    while (!ending) {
      char value = '0';
      std::ifstream(SysfsOf(kTrigger, "value")) >> value;
      if (value == '1') ++high;
    }
  });
  for (int pulses = 0; pulses < 5 && !HasFailure(); ++pulses) {
    const int before = high;
    EXPECT_EQ(port_->Write(kTrigger, true), OkStatus());
    EXPECT_EQ(port_->Write(kTrigger, false), OkStatus());
    EXPECT_TRUE(Eventually([&] { return high > before; })) << pulses;
    EXPECT_TRUE(Eventually([&] { return !Level(kTrigger); })) << pulses;
  }
  ending = true;
  sampler.join();
}

TEST_F(GpioLines, AreFoundByTheirName) {
  port_.reset();
  GpioLineOptions options;
  options.chip = kLabel;
  options.inputs = {kEstop, 7};
  options.names = {{7, "DOOR"}};
  auto port = GpioLinePort::Open(clock_, options);
  ASSERT_TRUE(port.ok()) << port.status();
  EXPECT_TRUE((*port)->Read(7).value()) << "line 7 has no pull";
  Pull(kDoor, false);
  EXPECT_FALSE((*port)->Read(7).value());
  port->reset();
  options.names = {{7, "TRAPDOOR"}};
  const Status none = GpioLinePort::Open(clock_, options).status();
  EXPECT_TRUE(absl::IsNotFound(none));
  EXPECT_THAT(std::string(Message(none)), HasSubstr("TRAPDOOR"));
}

TEST_F(GpioLines, TheKernelGivesALineToOneProcess) {
  const std::string info = Shell("gpioinfo " + chip_);
  EXPECT_THAT(info, HasSubstr("\"mesorigd\""));
  EXPECT_THAT(Shell(fmt::format("gpioget {} {}", chip_, kDoor)), HasSubstr("busy"));
  GpioLineOptions options;
  options.chip = kLabel;
  options.inputs = {kDoor};
  const Status second = GpioLinePort::Open(clock_, options).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(second));
  EXPECT_THAT(std::string(Message(second)), HasSubstr("line 1 is in use by mesorigd"));
  // A free one, as gpioget sees it.
  Pull(6, true);
  EXPECT_EQ(Shell(fmt::format("gpioget {} 6", chip_)), "1\n");
}

// The chip is unplugged: reading fails (which the interlock takes for open), and when it is back its
// output is as it was told last, and what changed meanwhile is told.
TEST_F(GpioLines, AChipThatIsUnpluggedComesBack) {
  ASSERT_EQ(port_->Write(kTrigger, true), OkStatus());
  Shell("echo 0 > /sys/kernel/config/gpio-sim/rig/live");
  ASSERT_TRUE(Eventually([&] { return !port_->Read(kDoor).ok(); }));
  Shell("echo 1 > /sys/kernel/config/gpio-sim/rig/live");
  ASSERT_TRUE(Eventually([&] { return port_->Read(kDoor).ok(); }));
  FindChip();
  EXPECT_FALSE(Level(kDoor)) << "gpio-sim forgets its pulls";
  ASSERT_TRUE(Eventually([&] { return Edges().size() == 2; }));
  EXPECT_THAT(Edges(), ElementsAre(Pair(kEstop, false), Pair(kDoor, false)));
  EXPECT_THAT(Shell("cat " + SysfsOf(kTrigger, "value")), HasSubstr("1"));
}

TEST(GpioChips, ThatAreNone) {
  SystemRigClock clock;
  GpioLineOptions options;
  options.chip = "gpiochip77";
  EXPECT_TRUE(absl::IsNotFound(GpioLinePort::Open(clock, options).status()));
  options.chip = kLabel;
  options.inputs = {99};
  EXPECT_TRUE(absl::IsInvalidArgument(GpioLinePort::Open(clock, options).status()));
}

}  // namespace
}  // namespace mesorig::daemon
