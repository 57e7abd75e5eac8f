#include "daemon/safety/lamp_hours.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <thread>

#include "protocol/base/file_writer.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class LampHoursTest : public ::testing::Test {
 protected:
  LampHoursTest() {
    rig_.lamp_bank.rated_hours = 10;
    std::filesystem::create_directories(folder_);
  }
  ~LampHoursTest() override { std::filesystem::remove_all(folder_); }
  void Write(std::string_view text) { ASSERT_EQ(WriteFileAtomically(file_, text), OkStatus()); }
  std::vector<double> HoursInFile() {
    LampHours hours(rig_);
    EXPECT_EQ(hours.Keep(file_), OkStatus());
    return hours.Hours({});
  }
  // Burns `lamp` from..to, told as the watch does; a disk that is behind is waited for.
  static void Burn(LampHours& hours, int lamp, double from_s, double to_s) {
    hours.Burn(lamp, FromSeconds(from_s));
    for (double t = from_s; t <= to_s; t += 0.1) {
      hours.Tick(FromSeconds(t));
      while (hours.Unwritten_s() > 31) std::this_thread::yield();
    }
  }

  Rig rig_ = SmallRig();
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / fmt::format("mesorig-hours-{}", ::getpid());
  const std::filesystem::path file_ = folder_ / "lamp_hours.tsv";
};

TEST_F(LampHoursTest, AreCountedAndKept) {
  {
    LampHours hours(rig_);
    ASSERT_EQ(hours.Keep(file_), OkStatus());
    hours.Burn(1, FromSeconds(100));
    hours.Burn(0, FromSeconds(100 + 3600 * 12));
    hours.Burn(-1, FromSeconds(100 + 3600 * 13));
    EXPECT_THAT(hours.Hours(FromSeconds(1e6)), ElementsAre(1, 12));
  }
  LampHours again(rig_);
  ASSERT_EQ(again.Keep(file_), OkStatus());
  EXPECT_THAT(again.Hours({}), ElementsAre(1, 12));
  EXPECT_THAT(again.Overdue({}),
              ElementsAre(HasSubstr("lamp L1 has burnt 12.0 h of the 10 h")));
}

// A lamp that burns on and on is written without being switched.
TEST_F(LampHoursTest, AreWrittenWhileALampBurns) {
  LampHours hours(rig_);
  ASSERT_EQ(hours.Keep(file_), OkStatus());
  hours.Burn(0, {});
  hours.Tick(FromSeconds(29.9));
  EXPECT_NEAR(hours.Unwritten_s(), 29.9, 1e-6);
  EXPECT_FALSE(std::filesystem::exists(file_));
  hours.Tick(FromSeconds(30));
  while (hours.Unwritten_s() > 0) std::this_thread::yield();
  EXPECT_NEAR(HoursInFile()[0] * 3600, 30, 0.01);
  Burn(hours, 0, 30, 3630);
  EXPECT_LE(hours.Unwritten_s(), 31);
  EXPECT_NEAR(hours.Hours(FromSeconds(3630))[0], 3630.0 / 3600, 1e-9);
}

TEST_F(LampHoursTest, AKillCostsAMinuteAtMost) {
  for (const double at_s : {0.05, 12.3, 29.9, 30.05, 59.9, 100.0, 1234.5, 3600.0}) {
    Write("lamp\thours\nL0\t5\nL1\t7\n");
    const pid_t child = ::fork();
    if (child == 0) {
      LampHours hours(rig_);
      if (!hours.Keep(file_).ok()) ::_exit(1);
      Burn(hours, 1, 0, at_s);
      ::kill(::getpid(), SIGKILL);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    const std::vector<double> hours = HoursInFile();
    EXPECT_EQ(hours[0], 5);
    const double lost_s = at_s - (hours[1] - 7) * 3600;
    EXPECT_GE(lost_s, -0.1) << at_s;
    EXPECT_LE(lost_s, 60) << at_s;
  }
}

TEST_F(LampHoursTest, ADamagedFileIsToldAndLeftAsItIs) {
  const struct {
    std::string text, says;
  } cases[] = {
      {"", ": is empty"},
      {"lamps\n", ":1: is \"lamps\", not \"lamp<tab>hours\""},
      {"lamp\thours\nL0\t3\nL1 4\n", ":3: \"L1 4\" is not LAMP<tab>HOURS"},
      {"lamp\thours\nL0\t-3\n", ":2: \"L0\t-3\" is not LAMP<tab>HOURS with hours in [0, 1e+07]"},
      {"lamp\thours\nL0\tnan\n", ":2: \"L0\tnan\" is not"},
      {"lamp\thours\nL0\t3\nL0\t4\n", ":3: lamp \"L0\" is there twice"},
  };
  for (const auto& [text, says] : cases) {
    Write(text);
    {
      LampHours hours(rig_);
      const Status kept = hours.Keep(file_);
      EXPECT_TRUE(absl::IsInvalidArgument(kept)) << kept;
      EXPECT_THAT(std::string(Message(kept)), HasSubstr(file_.string() + says));
      Burn(hours, 0, 0, 20);
      EXPECT_NEAR(hours.Hours(FromSeconds(20))[0] * 3600, 20, 1e-6) << "nothing read by half";
    }
    EXPECT_EQ(ReadFile(file_).value(), text) << "a person mends it";
  }
}

TEST_F(LampHoursTest, AnyDamageIsToldOrHarmless) {
  const std::string text = "lamp\thours\nL0\t1.250000\nL1\t12.000000\nold\t99.5\n";
  for (size_t at = 0; at < text.size(); ++at) {
    for (const char byte : {'\0', '\t', '\n', '-', 'x'}) {
      std::string damaged = text.substr(0, at) + byte + text.substr(at + 1);
      if (byte == '\0') damaged = text.substr(0, at);
      Write(damaged);
      LampHours hours(rig_);
      const Status kept = hours.Keep(file_);
      EXPECT_TRUE(kept.ok() || absl::IsInvalidArgument(kept)) << kept;
      for (const double h : hours.Hours({})) EXPECT_TRUE(h >= 0 && h <= 1e7);
    }
  }
}

// Lamps of another rig, or that were taken away, keep their hours.
TEST_F(LampHoursTest, LinesOfOtherLampsStay) {
  Write("lamp\thours\nold\t99.5\nL1\t12\n");
  {
    LampHours hours(rig_);
    ASSERT_EQ(hours.Keep(file_), OkStatus());
    Burn(hours, 0, 0, 36);
  }
  const std::string text = ReadFile(file_).value();
  EXPECT_THAT(text, HasSubstr("L1\t12.000000\n"));
  EXPECT_THAT(text, HasSubstr("old\t99.5\n"));
}

}  // namespace
}  // namespace mesorig::daemon
