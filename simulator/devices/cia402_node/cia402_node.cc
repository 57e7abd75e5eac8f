#include "simulator/devices/cia402_node/cia402_node.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace mesorig::simulator {
namespace {

using sim_wire::CanFrame;
using std::chrono::milliseconds;

constexpr uint8_t kProfilePosition = 1, kHoming = 6;
constexpr uint16_t kEmergencyHeartbeat = 0x8130, kEmergencyPower = 0x3130,
                   kEmergencyHot = 0x4310;

void PutLittle(CanFrame& frame, int at, int bytes, uint32_t value) {
  for (int i = 0; i < bytes; ++i) frame.data[at + i] = static_cast<uint8_t>(value >> (8 * i));
}

}  // namespace

Cia402Node::Cia402Node(const Axis& axis, double power_on_counts)
    : axis_(axis),
      motion_(plant::MotionProfile::Standing(power_on_counts)),
      encoder_zero_(power_on_counts) {
  Reset(RigTime(0));
  output_.clear();  // the boot-up message of the start is before anybody listened
}

void Cia402Node::Reset(RigTime now) {
  constexpr int64_t kMax32 = 0x7FFFFFFF, kMaxU32 = 0xFFFFFFFF;
  const double per_rad = axis_.counts_per_turn / (2 * kPi);
  const auto counts = [&](double rad) { return static_cast<uint32_t>(rad * per_rad); };
  auto& d = dictionary_;
  d.Add(0x1000, 0, {4, false, 0, 0, 0x00040192});  // stepper drive, profile 402
  d.Add(0x1016, 0, {1, false, 0, 0, 1});
  d.Add(0x1016, 1, {4, true, 0, kMaxU32, 0});
  d.Add(0x1017, 0, {2, true, 0, 0xFFFF, 0});
  d.Add(0x1018, 0, {1, false, 0, 0, 1});
  d.Add(0x1018, 1, {4, false, 0, 0, 0});
  d.Add(0x1802, 5, {2, true, 0, 0xFFFF, 100});
  d.Add(kReferenceFound, 0, {4, false, -kMax32 - 1, kMax32, 0});
  d.Add(0x6007, 0, {2, true, -32768, 3, 1});
  d.Add(0x605A, 0, {2, true, 2, 2, 2});  // quick stop: on its ramp, then torque off; no other
  d.Add(0x6040, 0, {2, true, 0, 0xFFFF, 0});
  d.Add(0x6041, 0, {2, false, 0, 0, 0});
  d.Add(0x6060, 0, {1, true, -128, 127, kProfilePosition});
  d.Add(0x6061, 0, {1, false, 0, 0, kProfilePosition});
  d.Add(0x6064, 0, {4, false, -kMax32 - 1, kMax32, 0});
  d.Add(0x607A, 0, {4, true, -kMax32 - 1, kMax32, 0});
  d.Add(0x607C, 0, {4, true, -kMax32 - 1, kMax32, 0});
  d.Add(0x607D, 0, {1, false, 0, 0, 2});  // software position limits; min not below max: none
  d.Add(0x607D, 1, {4, true, -kMax32 - 1, kMax32, 0});
  d.Add(0x607D, 2, {4, true, -kMax32 - 1, kMax32, 0});
  d.Add(0x6065, 0, {4, true, 0, kMaxU32, kMaxU32});  // following error window; all ones: none
  d.Add(0x6081, 0, {4, true, 1, kMaxU32, counts(axis_.max_velocity_rad_s)});
  d.Add(0x6083, 0, {4, true, 1, kMaxU32, counts(axis_.acceleration_rad_s2)});
  d.Add(0x6084, 0, {4, true, 1, kMaxU32, counts(axis_.acceleration_rad_s2)});
  d.Add(0x6085, 0, {4, true, 1, kMaxU32, counts(4 * axis_.acceleration_rad_s2)});
  d.Add(0x6098, 0, {1, true, -128, 127, 24});
  d.Add(0x6099, 0, {1, false, 0, 0, 2});
  d.Add(0x6099, 1, {4, true, 1, kMaxU32, counts(axis_.homing_velocity_rad_s)});
  d.Add(0x6099, 2, {4, true, 1, kMaxU32, std::max(1u, counts(axis_.homing_velocity_rad_s / 10))});
  d.Add(0x609A, 0, {4, true, 1, kMaxU32, counts(axis_.acceleration_rad_s2)});
  d.Add(0x6502, 0, {4, false, 0, 0, 1u << 0 | 1u << 5});  // supported modes
  operational_ = false;
  state_ = State::kSwitchOnDisabled;
  homing_ = homing_attained_ = homing_error_ = set_point_ack_ = false;
  target_reached_ = true;
  next_heartbeat_ = consumer_deadline_ = next_status_ = kNever;
  controlword_ = 0;
  StandStill(now);
  output_.push_back({static_cast<uint16_t>(0x700 + node()), 1, {0}});  // boot-up
}

void Cia402Node::Receive(const CanFrame& frame, RigTime now) {
  const uint16_t id = frame.id;
  if (id == 0x000 && frame.size == 2 && (frame.data[1] == 0 || frame.data[1] == node())) {
    Nmt(frame.data[0], now);
  } else if (id == 0x600 + node()) {
    Sdo(frame, now);
  } else if (id == 0x400 + node() && frame.size == 6 && operational_) {
    uint32_t target = 0;
    for (int i = 0; i < 4; ++i) target |= uint32_t{frame.data[2 + i]} << (8 * i);
    dictionary_.Set(0x607A, 0, target);
    Controlword(static_cast<uint16_t>(frame.data[0] | frame.data[1] << 8), now);
  } else if (id > 0x700 && id <= 0x77F) {
    const uint32_t consumer = Value(0x1016, 1);
    if ((consumer >> 16 & 0x7F) == (id & 0x7F) && (consumer & 0xFFFF) != 0) {
      consumer_deadline_ = now + milliseconds(consumer & 0xFFFF);
    }
  }
  SendStatusIfChanged(now);
  NoteTorque(now);
}

void Cia402Node::Nmt(uint8_t command, RigTime now) {
  switch (command) {
    case 0x01:
      operational_ = true;
      SendStatus(now);
      return;
    case 0x02:
    case 0x80:
      operational_ = false;
      return;
    case 0x81:
    case 0x82:
      return Reset(now);
    default:
      return;
  }
}

void Cia402Node::Sdo(const CanFrame& frame, RigTime now) {
  dictionary_.Set(0x6041, 0, Statusword(now));
  dictionary_.Set(0x6064, 0, static_cast<uint32_t>(ActualCounts(now)));
  std::optional<uint32_t> written;
  output_.push_back(dictionary_.Serve(frame, static_cast<uint8_t>(node()), written));
  if (!written) return;
  switch (*written >> 8) {
    case 0x1016:  // monitoring starts with the first heartbeat, CiA 301, 7.2.8.2.2
      consumer_deadline_ = kNever;
      return;
    case 0x1017:
      next_heartbeat_ =
          Value(0x1017) == 0 ? kNever : now + milliseconds(static_cast<int64_t>(Value(0x1017)));
      return;
    case 0x6040:
      return Controlword(static_cast<uint16_t>(Value(0x6040)), now);
    case 0x6060:
      dictionary_.Set(0x6061, 0, Value(0x6060));
      homing_attained_ = homing_error_ = false;
      return;
    default:
      return;
  }
}

void Cia402Node::Controlword(uint16_t word, RigTime now) {
  const uint16_t rising = static_cast<uint16_t>(word & ~controlword_);
  controlword_ = word;
  if (state_ == State::kFault) {
    if ((rising & 0x80) != 0 && power_ && !hot_) state_ = State::kSwitchOnDisabled;
    return;
  }
  Transition(word, now);
  if (state_ != State::kOperationEnabled) return;
  if ((word & 0x10) == 0) set_point_ack_ = false;
  if ((rising & 0x10) == 0) return;
  if (Value(0x6061) == kHoming) {
    StartHoming(now);
  } else if (Value(0x6061) == kProfilePosition) {
    NewSetPoint(now);
  }
}

void Cia402Node::Transition(uint16_t word, RigTime now) {  // CiA 402, table "command coding"
  if ((word & 0x02) == 0) {                                // disable voltage
    state_ = State::kSwitchOnDisabled;
    StandStill(now);
  } else if ((word & 0x04) == 0) {  // quick stop, active low
    if (state_ == State::kOperationEnabled) {
      QuickStop(now);
    } else if (state_ != State::kQuickStopActive) {
      state_ = State::kSwitchOnDisabled;
    }
  } else if ((word & 0x07) == 0x06) {  // shutdown
    if (state_ == State::kOperationEnabled) StandStill(now);
    if (power_ && state_ != State::kQuickStopActive) state_ = State::kReadyToSwitchOn;
  } else if ((word & 0x0F) == 0x07) {  // switch on
    if (state_ == State::kOperationEnabled) StandStill(now);
    if (state_ == State::kReadyToSwitchOn || state_ == State::kOperationEnabled) {
      state_ = State::kSwitchedOn;
    }
  } else if ((word & 0x0F) == 0x0F) {  // enable operation
    if (state_ == State::kSwitchedOn || state_ == State::kReadyToSwitchOn) {
      state_ = State::kOperationEnabled;
    }
  }
}

void Cia402Node::Fault(uint16_t emergency_code, RigTime now) {
  if (state_ == State::kOperationEnabled) QuickStop(now);
  state_ = State::kFault;
  CanFrame emergency{static_cast<uint16_t>(0x80 + node()), 8, {}};
  PutLittle(emergency, 0, 2, emergency_code);
  emergency.data[2] = 1;  // generic error
  output_.push_back(emergency);
}

void Cia402Node::HeartbeatLost(RigTime now) {
  consumer_deadline_ = kNever;
  switch (Value(0x6007)) {
    case 1:
      return Fault(kEmergencyHeartbeat, now);
    case 2:
      state_ = State::kSwitchOnDisabled;
      return StandStill(now);
    case 3:
      if (state_ == State::kOperationEnabled) QuickStop(now);
      return;
    default:
      return;
  }
}

void Cia402Node::SetSupply(bool on, RigTime now) {
  if (on == supplied_) return;
  supplied_ = on;
  if (on) {
    StandStill(now);
    encoder_zero_ = WorldCounts(now);
    return Reset(now);
  }
  StandStill(now);
  state_ = State::kSwitchOnDisabled;
  operational_ = false;
  next_heartbeat_ = consumer_deadline_ = next_status_ = kNever;
  output_.clear();
  NoteTorque(now);
}

void Cia402Node::SetHot(bool hot, RigTime now) {
  if (hot && !hot_ && supplied_) Fault(kEmergencyHot, now);
  hot_ = hot;
  SendStatusIfChanged(now);
  NoteTorque(now);
}

bool Cia402Node::HasTorque() const {
  if (!power_ || !supplied_) return false;
  return state_ == State::kOperationEnabled || state_ == State::kQuickStopActive ||
         (state_ == State::kFault && motion_pending_);
}

void Cia402Node::NoteTorque(RigTime now) {
  if (HasTorque() == had_torque_) return;
  had_torque_ = !had_torque_;
  if (on_torque_) on_torque_(had_torque_, now);
}

void Cia402Node::SetPower(bool on, RigTime now) {
  power_ = on;
  if (!supplied_) return;
  if (!on) {
    // Torque is gone at once; the gear's friction holds the axis where it is.
    StandStill(now);
    Fault(kEmergencyPower, now);
  }
  SendStatusIfChanged(now);
  NoteTorque(now);
}

RigTime Cia402Node::NextEvent() const {
  const RigTime end = motion_pending_ ? motion_start_ + FromSeconds(motion_.duration_s()) : kNever;
  return std::min({end, next_heartbeat_, consumer_deadline_, next_status_});
}

void Cia402Node::RunEvent(RigTime now) {
  if (now >= consumer_deadline_) HeartbeatLost(now);
  if (now >= next_heartbeat_) {
    next_heartbeat_ = now + milliseconds(static_cast<int64_t>(Value(0x1017)));
    const uint8_t nmt_state = operational_ ? 0x05 : 0x7F;
    output_.push_back({static_cast<uint16_t>(0x700 + node()), 1, {nmt_state}});
  }
  if (motion_pending_ && now >= motion_start_ + FromSeconds(motion_.duration_s())) MotionEnded(now);
  if (now >= next_status_) {
    next_status_ = now + milliseconds(static_cast<int64_t>(Value(0x1802, 5)));
    SendStatus(now);
  }
  SendStatusIfChanged(now);
  NoteTorque(now);
}

uint16_t Cia402Node::Statusword(RigTime now) const {
  constexpr uint16_t kRemote = 0x200, kVoltage = 0x10;
  uint16_t word = kRemote;
  if (power_) word |= kVoltage;
  switch (state_) {
    case State::kSwitchOnDisabled:
      word |= 0x40;
      break;
    case State::kReadyToSwitchOn:
      word |= 0x21;
      break;
    case State::kSwitchedOn:
      word |= 0x23;
      break;
    case State::kOperationEnabled:
      word |= 0x27;
      break;
    case State::kQuickStopActive:
      word |= 0x07;
      break;
    case State::kFault:
      word |= 0x08;
      break;
  }
  if (target_reached_) word |= 1 << 10;
  if (limited_) word |= 1 << 11;
  const bool homing_mode = Value(0x6061) == kHoming;
  if (homing_mode ? homing_attained_ : set_point_ack_) word |= 1 << 12;
  if (homing_mode ? homing_error_ : FollowingError(now)) word |= 1 << 13;
  return word;
}

void Cia402Node::SendStatus(RigTime now) {
  if (!operational_) return;
  last_statusword_ = Statusword(now);
  CanFrame frame{static_cast<uint16_t>(0x380 + node()), 6, {}};
  PutLittle(frame, 0, 2, last_statusword_);
  PutLittle(frame, 2, 4, static_cast<uint32_t>(ActualCounts(now)));
  output_.push_back(frame);
}

void Cia402Node::SendStatusIfChanged(RigTime now) {
  if (Statusword(now) != last_statusword_) SendStatus(now);
}

}  // namespace mesorig::simulator
