#pragma once
// What may be energised: a state machine without clock or I/O, stepped with what is read back and
// what was pressed. Safety (safety.h) feeds it; tests/daemon/safety/safety_logic_test.cc explores
// every state that it can reach. docs/safety.md tells the rules to people.
//
// Whatever trips is latched. What somebody did at the rig (e-stop, door, power gone, the start
// itself) is cleared by a reset edge at the rig alone, and only when the chain was seen closed
// before it; the rest by that, or by a console's reset with the chain closed. Neither clears a
// cause that is still there. Closing the chain clears nothing.

#include <cstdint>
#include <string>
#include <string_view>

namespace mesorig::daemon {

enum class TripCause : uint8_t {
  // Cleared at the rig:
  kEstop,
  kDoor,
  kPower,  // the contactor is open though the chain is closed
  kStart,  // nobody has pressed reset since the rig was switched on
  // Cleared at the rig or by a console:
  kUnreadable,  // a line of the chain, while something was energised
  kContactor,   // closed though the chain is open
  kLight,       // a lamp is lit that nobody asked for
  kMotion,      // torque or motion that nobody asked for
  kLaser,       // shines though its gate is shut
  kHot,
  kHung,  // whoever energised the rig makes no progress
};
inline constexpr int kTripCauses = 11;
inline constexpr int kRigCauses = 4;  // the first ones
std::string_view Text(TripCause cause);  // "emergency stop", ...

constexpr uint16_t Bit(TripCause cause) {
  return static_cast<uint16_t>(1u << static_cast<unsigned>(cause));
}

// Levels as they are now, but for the two resets. Values are false where nothing is known: that is
// the safe side of the chain, and whoever feeds says the rest.
struct SafetyInputs {
  bool readable = false;             // both lines of the chain
  bool estop = false, door = false;  // closed
  bool reset_edge = false;           // pressed at the rig
  bool console_reset = false;
  bool energised = false;  // asked for, or read back as on
  bool moving = false;     // an axis, commanded or read back
  // Of each cause from kContactor on, and kPower: it is there now.
  bool power_lost = false, contactor_stuck = false, light_stuck = false, motion_stuck = false;
  bool laser_stuck = false, hot = false, hung = false;
};

struct SafetyOutputs {
  bool may_energise = false;  // torque and lamps
  bool may_shine = false;     // the laser
  bool de_energise = false;   // now: lamps off, gate shut, axes quick-stopped
};

// A value; equal values behave equally.
class SafetyLogic {
 public:
  // The rig's own latch (the contactor) tells that somebody has pressed reset since the rig was
  // switched on. For the start alone.
  void TakeTheRigsWord() { latched_ &= static_cast<uint16_t>(~Bit(TripCause::kStart)); }

  SafetyOutputs Step(const SafetyInputs& inputs);
  uint16_t latched() const { return latched_; }  // bits of TripCause
  bool Has(TripCause cause) const { return (latched_ & Bit(cause)) != 0; }
  bool needs_the_rig() const { return (latched_ & ((1u << kRigCauses) - 1)) != 0; }

  friend bool operator==(const SafetyLogic&, const SafetyLogic&) = default;
  uint32_t Key() const { return latched_ * 2u + (was_closed_ ? 1 : 0); }  // equal for equal values

 private:
  uint16_t latched_ = Bit(TripCause::kStart);
  bool was_closed_ = false;
};

}  // namespace mesorig::daemon
