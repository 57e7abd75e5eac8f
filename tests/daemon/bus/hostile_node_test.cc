// A node that answers with mutated frames: the CiA 402 driver must end every call with a status and
// within its deadlines, never crash, and never take garbage for an enabled axis at its target.

#include <gtest/gtest.h>

#include <map>
#include <random>

#include "daemon/drivers/cia402/sdo_client.h"
#include "daemon/drivers/driver.h"
#include "tests/daemon/fakes/fake_can_port.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/small_rig.h"

namespace mesorig::daemon {
namespace {

// A node that agrees to everything and remembers what was written, its frames mutated with a
// probability.
class HostileNode {
 public:
  HostileNode(int node, uint32_t seed, int mutate_percent)
      : node_(node), random_(seed), mutate_percent_(mutate_percent) {}
  std::vector<CanFrame> Answer(const CanFrame& frame) {
    std::vector<CanFrame> said;
    if (frame.id == 0x600 + node_) {
      CanFrame reply{static_cast<uint16_t>(0x580 + node_), 8, frame.data};
      const bool upload = frame.data[0] == 0x40;
      const bool statusword = frame.data[1] == 0x41;
      reply.data[0] = upload ? (statusword ? 0x4B : 0x43) : 0x60;
      if (frame.data[1] == 0x40 && frame.data[2] == 0x60) Follow(frame.data[4]);
      const uint32_t object = cia402::GetLittle(frame, 1, 3);  // index and sub-index
      if (!upload) written_[object] = cia402::GetLittle(frame, 4, 4);
      const uint32_t value = statusword ? statusword_ : written_[object];
      for (int i = 0; upload && i < 4; ++i)
        reply.data[4 + i] = static_cast<uint8_t>(value >> 8 * i);
      said.push_back(reply);
      said.push_back(Status());
    } else if (frame.id == 0x400 + node_) {
      statusword_ = (frame.data[0] & 0x10) != 0 ? 0x1637 : 0x0637;
      said.push_back(Status());
    }
    for (CanFrame& each : said) Mutate(each);
    return said;
  }

 private:
  void Follow(uint8_t controlword) {
    statusword_ = controlword == 0x06   ? 0x0631
                  : controlword == 0x07 ? 0x0633
                  : controlword == 0x0F ? 0x0637
                  : controlword == 0x1F ? 0x1637  // homing attained
                                        : 0x0650;
  }
  CanFrame Status() const {
    CanFrame frame{static_cast<uint16_t>(0x380 + node_), 6, {}};
    frame.data[0] = static_cast<uint8_t>(statusword_);
    frame.data[1] = static_cast<uint8_t>(statusword_ >> 8);
    return frame;
  }
  void Mutate(CanFrame& frame) {
    if (static_cast<int>(random_() % 100) >= mutate_percent_) return;
    switch (random_() % 4) {
      case 0:
        frame.size = static_cast<uint8_t>(random_() % 9);
        break;
      case 1:
        frame.data[random_() % 8] ^= static_cast<uint8_t>(1u << random_() % 8);
        break;
      case 2: {
        constexpr int kBases[] = {0x080, 0x380, 0x580, 0x700};
        frame.id = static_cast<uint16_t>(kBases[random_() % 4] + node_);
        break;
      }
      default:
        for (uint8_t& byte : frame.data) byte = static_cast<uint8_t>(random_());
    }
  }
  const int node_;
  std::mt19937 random_;
  const int mutate_percent_;
  uint16_t statusword_ = 0x0650;
  std::map<uint32_t, uint32_t> written_;
};

struct Outcome {
  bool reached = false;
  RigTime took{};
};

Outcome Drive(uint32_t seed, int mutate_percent) {
  const Rig rig = SmallRig();
  FakeRigClock clock;
  StopFlag stop(clock);
  HostileNode node(rig.axes[0].can_node, seed, mutate_percent);
  FakeCanPort port(clock, [&](const CanFrame& frame) { return node.Answer(frame); });
  CanBus bus(clock, port, {});
  DriverContext context;
  context.clock = &clock;
  context.rig = &rig;
  context.stop = &stop;
  context.can = &bus;
  auto axis = MakeAxis("cia402", context, 0).value();
  RigClock::Member member(clock, "test");
  RigClock::Activity activity(clock, Pace::kFree);
  Outcome outcome;
  const auto all = [&]() -> Status {
    MESORIG_RETURN_IF_ERROR(axis->Enable());
    MESORIG_RETURN_IF_ERROR(axis->StartHoming());
    MESORIG_RETURN_IF_ERROR(axis->AwaitHoming(clock.Now() + std::chrono::seconds(10)));
    MESORIG_RETURN_IF_ERROR(axis->StartMove(0));
    return axis->AwaitMove(clock.Now() + std::chrono::seconds(10));
  };
  const Status status = all();
  EXPECT_TRUE(status.ok() || !Message(status).empty());
  outcome.reached = status.ok();
  (void)axis->QuickStop();
  (void)axis->Disable();
  EXPECT_FALSE(axis->Read().enabled);
  outcome.took = clock.Now();
  return outcome;
}

TEST(HostileNode, HonestOneWorks) { EXPECT_TRUE(Drive(1, 0).reached); }

TEST(HostileNode, MutatedFramesNeverHangNorCrash) {
  int reached = 0;
  for (uint32_t seed = 0; seed < 4000; ++seed) {
    const Outcome outcome = Drive(seed, 1 + static_cast<int>(seed % 40));
    reached += outcome.reached ? 1 : 0;
    ASSERT_LT(outcome.took, RigTime(std::chrono::seconds(60))) << "seed " << seed;
  }
  EXPECT_GT(reached, 100);   // some mutations do not matter
  EXPECT_LT(reached, 3900);  // most are noticed
}

}  // namespace
}  // namespace mesorig::daemon
