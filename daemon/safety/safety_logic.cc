#include "daemon/safety/safety_logic.h"

namespace mesorig::daemon {

std::string_view Text(TripCause cause) {
  switch (cause) {
    case TripCause::kEstop:
      return "emergency stop";
    case TripCause::kDoor:
      return "door";
    case TripCause::kPower:
      return "the contactor is open";
    case TripCause::kStart:
      return "reset was not pressed since the rig was switched on";
    case TripCause::kUnreadable:
      return "the interlock chain could not be read";
    case TripCause::kContactor:
      return "the contactor does not open";
    case TripCause::kLight:
      return "a lamp is lit that nobody asked for";
    case TripCause::kMotion:
      return "an axis has torque or moves that nobody asked for";
    case TripCause::kLaser:
      return "the laser shines though its gate is shut";
    case TripCause::kHot:
      return "over-temperature";
    case TripCause::kHung:
      return "no progress";
  }
  return "";
}

SafetyOutputs SafetyLogic::Step(const SafetyInputs& in) {
  const auto bit = [](bool there, TripCause cause) -> uint16_t { return there ? Bit(cause) : 0; };
  const bool closed = in.readable && in.estop && in.door;
  const auto present = static_cast<uint16_t>(
      bit(in.readable && !in.estop, TripCause::kEstop) |
      bit(in.readable && !in.door, TripCause::kDoor) | bit(in.power_lost, TripCause::kPower) |
      bit(!in.readable && in.energised, TripCause::kUnreadable) |
      bit(in.contactor_stuck, TripCause::kContactor) | bit(in.light_stuck, TripCause::kLight) |
      bit(in.motion_stuck, TripCause::kMotion) | bit(in.laser_stuck, TripCause::kLaser) |
      bit(in.hot, TripCause::kHot) | bit(in.hung, TripCause::kHung));
  if (in.console_reset && closed) latched_ &= (1u << kRigCauses) - 1;
  if (in.reset_edge && closed && was_closed_) latched_ = 0;
  latched_ |= present;
  was_closed_ = closed;
  SafetyOutputs out;
  out.may_energise = closed && latched_ == 0;
  out.may_shine = out.may_energise && !in.moving;
  out.de_energise = !out.may_energise && in.energised;
  return out;
}

}  // namespace mesorig::daemon
