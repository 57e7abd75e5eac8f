// The safety logic, explored: every state that any sequence of inputs can reach, of any length (until
// no new state comes), under every input; then the same for a small rig around it, whose contactor
// works or is welded and whose plan asks for anything at any time; then long random sequences.

#include "daemon/safety/safety_logic.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <deque>
#include <random>
#include <unordered_map>
#include <unordered_set>
#include <vector>

namespace mesorig::daemon {
namespace {

constexpr int kInputBits = 14;

SafetyInputs InputsOf(uint32_t bits) {
  SafetyInputs in;
  bool* const all[] = {&in.readable,    &in.estop,         &in.door,         &in.reset_edge,
                       &in.console_reset, &in.energised,   &in.moving,       &in.power_lost,
                       &in.contactor_stuck, &in.light_stuck, &in.motion_stuck, &in.laser_stuck,
                       &in.hot,         &in.hung};
  static_assert(std::size(all) == kInputBits);
  for (int i = 0; i < kInputBits; ++i) *all[i] = (bits >> i & 1) != 0;
  return in;
}
bool Closed(const SafetyInputs& in) { return in.readable && in.estop && in.door; }
bool AnyCause(const SafetyInputs& in) {
  return in.power_lost || in.contactor_stuck || in.light_stuck || in.motion_stuck ||
         in.laser_stuck || in.hot || in.hung;
}

// What must hold of one step. Returns false at the first breach, so that millions of steps stay
// cheap.
bool StepHolds(const SafetyLogic& before, const SafetyInputs& in, const SafetyLogic& after,
               const SafetyOutputs& out, bool was_closed) {
  const bool closed = Closed(in);
  if ((out.may_energise || out.may_shine) && !closed) return false;
  if (out.may_energise && AnyCause(in)) return false;
  if (out.may_shine && (in.moving || !out.may_energise)) return false;
  if (out.de_energise != (in.energised && !out.may_energise)) return false;
  if (out.may_energise != (closed && after.latched() == 0)) return false;
  constexpr uint16_t kRig = (1u << kRigCauses) - 1;
  const auto cleared = static_cast<uint16_t>(before.latched() & ~after.latched());
  const bool at_rig = in.reset_edge && closed && was_closed;
  if ((cleared & kRig) != 0 && !at_rig) return false;  // reset counts after closing only
  if (cleared != 0 && !at_rig && !(in.console_reset && closed)) return false;
  // A chain that opens is latched, also when it is closed again at once.
  if (in.readable && !in.estop && !after.Has(TripCause::kEstop)) return false;
  if (in.readable && !in.door && !after.Has(TripCause::kDoor)) return false;
  return true;
}

SafetyLogic AfterReset() {
  SafetyLogic logic;
  logic.TakeTheRigsWord();
  return logic;
}

TEST(SafetyLogic, EveryReachableStateUnderEveryInput) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "67 million steps on one thread: ThreadSanitizer has nothing to see there";
#endif
  std::unordered_map<uint32_t, bool> was_closed_of;  // by key: the only other memory
  std::deque<SafetyLogic> open = {AfterReset(), SafetyLogic()};
  std::vector<SafetyLogic> reached(open.begin(), open.end());
  std::unordered_set<uint32_t> known = {open[0].Key(), open[1].Key()};
  uint64_t steps = 0, breaches = 0;
  int deepest = 0;
  std::deque<int> depths = {0, 0};
  while (!open.empty()) {
    const SafetyLogic state = open.front();
    const int depth = depths.front();
    open.pop_front();
    depths.pop_front();
    deepest = std::max(deepest, depth);
    const bool was_closed = (state.Key() & 1) != 0;
    for (uint32_t bits = 0; bits < 1u << kInputBits; ++bits) {
      const SafetyInputs in = InputsOf(bits);
      SafetyLogic next = state;
      const SafetyOutputs out = next.Step(in);
      ++steps;
      if (!StepHolds(state, in, next, out, was_closed) && ++breaches == 1) {
        ADD_FAILURE() << "state " << state.Key() << ", input " << bits;
      }
      if (!known.insert(next.Key()).second) continue;
      open.push_back(next);
      depths.push_back(depth + 1);
      reached.push_back(next);
    }
  }
  std::printf("safety logic: %zu states reached (the last after %d steps), %llu steps explored\n",
              known.size(), deepest, static_cast<unsigned long long>(steps));
  EXPECT_EQ(breaches, 0u);
  EXPECT_GT(known.size(), 2000u) << "the exploration reached too little to mean anything";

  // No trap: whatever happened, a closed chain and a reset at the rig lead back.
  SafetyInputs good;
  good.readable = good.estop = good.door = true;
  for (SafetyLogic state : reached) {
    state.Step(good);
    good.reset_edge = true;
    ASSERT_TRUE(state.Step(good).may_energise) << state.latched();
    good.reset_edge = false;
    ASSERT_TRUE(state.Step(good).may_energise);
  }
}

// The rig around it: hardware that obeys, or not.
struct Plant {
  SafetyLogic logic = AfterReset();
  bool contactor = true, torque = false, lamp = false, laser = false;
  bool was_open = false;  // the chain, at the step before
  uint64_t Key() const {
    return uint64_t{logic.Key()} << 8 | (contactor ? 1 : 0) | (torque ? 2 : 0) | (lamp ? 4 : 0) |
           (laser ? 8 : 0) | (was_open ? 16 : 0);
  }
};

// A hand, a plan and the hardware act: chain, resets, what the plan asks for (it obeys nobody).
struct Move {
  bool estop, door, readable, reset, console, torque, lamp, laser, moving, hot, hung;
};
constexpr int kMoveBits = 11;
Move MoveOf(uint32_t bits) {
  const auto bit = [&](int i) { return (bits >> i & 1) != 0; };
  return {bit(0), bit(1), bit(2), bit(3), bit(4), bit(5), bit(6), bit(7), bit(8), bit(9), bit(10)};
}

// One turn: hardware first, then what the software reads and does. `welded`: the contactor never
// opens again.
void Turn(Plant& plant, const Move& move, bool welded) {
  const bool closed = move.estop && move.door;  // the wires, whatever can be read
  if (!closed && !welded) plant.contactor = false;
  if (closed && move.reset) plant.contactor = true;
  if (!plant.contactor) plant.torque = plant.lamp = plant.laser = false;
  SafetyInputs in;
  in.readable = move.readable;
  in.estop = move.readable && move.estop;
  in.door = move.readable && move.door;
  in.reset_edge = move.reset;
  in.console_reset = move.console;
  in.energised = plant.torque || plant.lamp || plant.laser;
  in.moving = move.moving;
  in.contactor_stuck = !closed && move.readable && plant.contactor;
  in.power_lost = closed && move.readable && !plant.contactor;
  in.hot = move.hot;
  in.hung = move.hung && in.energised;
  const SafetyOutputs out = plant.logic.Step(in);
  if (out.de_energise) plant.torque = plant.lamp = plant.laser = false;
  if (!out.may_shine) plant.laser = false;  // no more edges
  if (plant.contactor) {                    // the guards refuse everybody else
    plant.torque = plant.torque || (out.may_energise && move.torque);
    plant.lamp = plant.lamp || (out.may_energise && move.lamp);
    plant.laser = plant.laser || (out.may_shine && move.laser);
  }
}

void ExplorePlant(bool welded) {
  std::deque<Plant> open = {Plant{}, Plant{SafetyLogic(), false}};
  std::unordered_set<uint64_t> known = {open[0].Key(), open[1].Key()};
  uint64_t turns = 0, breaches = 0;
  while (!open.empty()) {
    const Plant state = open.front();
    open.pop_front();
    for (uint32_t bits = 0; bits < 1u << kMoveBits; ++bits) {
      const Move move = MoveOf(bits);
      Plant next = state;
      Turn(next, move, welded);
      ++turns;
      // Also with the contactor welded: then the software alone takes light and torque.
      const bool chain_open = !move.estop || !move.door;
      const bool on = next.torque || next.lamp || next.laser;
      const bool unseen = chain_open && !move.readable;
      const bool wrong = (chain_open || unseen) && on;
      if ((wrong || (next.laser && move.moving)) && ++breaches == 1) {
        ADD_FAILURE() << "state " << state.Key() << ", move " << bits;
      }
      if (known.insert(next.Key()).second) open.push_back(next);
    }
  }
  std::printf("rig around it, contactor %s: %zu states reached, %llu turns explored\n",
              welded ? "welded" : "sound", known.size(), static_cast<unsigned long long>(turns));
  EXPECT_EQ(breaches, 0u);
  EXPECT_GT(known.size(), 100u);
}

TEST(SafetyLogic, NoLightOrTorqueWithAnOpenChainInAnyReachableState) { ExplorePlant(false); }
TEST(SafetyLogic, NorWithAContactorThatIsWelded) { ExplorePlant(true); }

TEST(SafetyLogic, LongRandomSequences) {
  std::mt19937 random(20050801);
  uint64_t permitted = 0;
  for (int sequence = 0; sequence < 200; ++sequence) {
    SafetyLogic logic = sequence % 2 == 0 ? AfterReset() : SafetyLogic();
    for (int step = 0; step < 2000; ++step) {
      // Mostly quiet, so that it also comes to be permitted.
      uint32_t bits = random() % (1u << kInputBits);
      if (random() % 4 != 0) bits &= 0b1111111;
      if (random() % 4 != 0) bits |= 0b111;
      const SafetyInputs in = InputsOf(bits);
      const SafetyLogic before = logic;
      const SafetyOutputs out = logic.Step(in);
      permitted += out.may_energise;
      ASSERT_TRUE(StepHolds(before, in, logic, out, (before.Key() & 1) != 0))
          << "sequence " << sequence << ", step " << step;
    }
  }
  EXPECT_GT(permitted, 10'000u) << "a logic that never permits would hold all of this";
}

TEST(SafetyLogic, ResetCountsOnlyAfterClosing) {
  SafetyLogic logic = AfterReset();
  SafetyInputs in;
  in.readable = in.estop = in.door = true;
  EXPECT_TRUE(logic.Step(in).may_energise);
  in.estop = false;
  in.reset_edge = true;  // held down while it is open
  EXPECT_FALSE(logic.Step(in).may_energise);
  in.estop = true;  // and while it closes
  EXPECT_FALSE(logic.Step(in).may_energise);
  in.reset_edge = false;
  in.console_reset = true;
  EXPECT_FALSE(logic.Step(in).may_energise) << "no console clears an emergency stop";
  in.console_reset = false;
  in.reset_edge = true;
  EXPECT_TRUE(logic.Step(in).may_energise);
}

TEST(SafetyLogic, ARigThatWasSwitchedOnNeedsAReset) {
  SafetyLogic logic;
  SafetyInputs in;
  in.readable = in.estop = in.door = in.console_reset = true;
  EXPECT_FALSE(logic.Step(in).may_energise);
  in.reset_edge = true;
  EXPECT_TRUE(logic.Step(in).may_energise);
}

}  // namespace
}  // namespace mesorig::daemon
