#include "simulator/devices/nxt_brick/nxt_brick.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "protocol/base/bytes.h"
#include "protocol/base/log.h"

namespace mesorig::simulator {
namespace {

using std::chrono::milliseconds;
using std::chrono::minutes;

constexpr RigTime kReplyTime = milliseconds(7);
constexpr RigTime kSleepTime = minutes(10);
constexpr size_t kPacketBytes = 64;

enum : uint8_t {
  kDirectWithReply = 0x00,
  kSystemWithReply = 0x01,
  kReply = 0x02,
  kDirectNoReply = 0x80,
};
enum : uint8_t {
  kSetOutputState = 0x04,
  kGetOutputState = 0x06,
  kResetMotorPosition = 0x0A,
  kGetBatteryLevel = 0x0B,
  kKeepAlive = 0x0D,
  kGetFirmwareVersion = 0x88,  // a system command
};
// Protocol 1.124, firmware 1.31: the minor number first.
constexpr uint8_t kVersions[] = {124, 1, 31, 1};
enum : uint8_t { kOk = 0x00, kUnknownCommand = 0xBE, kBadPacket = 0xBF, kOutOfRange = 0xC0 };
enum : uint8_t { kMotorOn = 0x01, kBrake = 0x02, kRegulated = 0x04 };
enum : uint8_t { kRegulateNothing = 0x00, kRegulateSpeed = 0x01 };
enum : uint8_t { kIdle = 0x00, kRunning = 0x20 };
constexpr uint8_t kAllPorts = 0xFF;

// Of the motor with its gear.
constexpr double kRunUp_s = 0.06, kBraking_s = 0.015, kCoasting_s = 0.25;
// Without regulation friction takes a tenth of the speed.
constexpr double kUnregulated = 0.9;

std::string Error(uint8_t code) { return std::string(1, static_cast<char>(code)); }

}  // namespace

NxtBrick::NxtBrick(const Rig& rig, LaserUnit& unit)
    : laser_(*rig.laser), unit_(unit), sleep_at_(kSleepTime) {}

void NxtBrick::Command(RigTime now, std::string_view telegram, sim_wire::Outbox&) {
  if (!on_ || telegram.empty()) return;
  const auto type = static_cast<uint8_t>(telegram[0]);
  const auto opcode = telegram.size() > 1 ? static_cast<uint8_t>(telegram[1]) : uint8_t{0};
  const bool is_system = type == kSystemWithReply;
  if (type != kDirectWithReply && type != kDirectNoReply && !is_system) {
    spdlog::warn("nxt: a telegram of type {:#04x} is left unanswered", type);
    return;
  }
  sleep_at_ = now + kSleepTime;
  std::string answer;
  if (telegram.size() < 2 || telegram.size() > kPacketBytes) {
    answer = Error(kBadPacket);
  } else {
    answer = is_system ? AnswerSystem(opcode, telegram.substr(2))
                       : Answer(now, opcode, telegram.substr(2));
  }
  if (type == kDirectNoReply) return;
  const RigTime at = (replies_.empty() ? now : std::max(now, replies_.back().first)) + kReplyTime;
  replies_.emplace_back(at, ByteWriter().Put<uint8_t>(kReply).Put(opcode).Take() + answer);
}

std::string NxtBrick::Answer(RigTime now, uint8_t opcode, std::string_view body) {
  switch (opcode) {
    case kSetOutputState:
      return body.size() == 10 ? SetOutputState(now, body) : Error(kBadPacket);
    case kGetOutputState:
      return body.size() == 1 ? GetOutputState(now, body) : Error(kBadPacket);
    case kResetMotorPosition:
      return body.size() == 2 ? ResetMotorPosition(now, body) : Error(kBadPacket);
    case kGetBatteryLevel:
      if (!body.empty()) return Error(kBadPacket);
      return ByteWriter().Put<uint8_t>(kOk).Put(BatteryMv(now)).Take();
    case kKeepAlive: {
      if (!body.empty()) return Error(kBadPacket);
      const auto sleep_ms = std::chrono::duration_cast<milliseconds>(kSleepTime).count();
      return ByteWriter().Put<uint8_t>(kOk).Put(static_cast<uint32_t>(sleep_ms)).Take();
    }
    default:
      return Error(kUnknownCommand);
  }
}

std::string NxtBrick::AnswerSystem(uint8_t opcode, std::string_view body) const {
  if (opcode != kGetFirmwareVersion) return Error(kUnknownCommand);
  if (!body.empty()) return Error(kBadPacket);
  std::string answer = Error(kOk);
  for (const uint8_t number : kVersions) answer.push_back(static_cast<char>(number));
  return answer;
}

// Port, power, mode, regulation, turn ratio, run state, tacho limit (u32).
std::string NxtBrick::SetOutputState(RigTime now, std::string_view body) {
  ByteReader in(body);
  const auto port = in.Get<uint8_t>();
  Port wanted;
  wanted.power = in.Get<int8_t>();
  wanted.mode = in.Get<uint8_t>();
  wanted.regulation = in.Get<uint8_t>();
  wanted.turn_ratio = in.Get<int8_t>();
  wanted.run_state = in.Get<uint8_t>();
  wanted.tacho_limit = in.Get<uint32_t>();
  const bool known =
      (port < ports_.size() || port == kAllPorts) && std::abs(int{wanted.power}) <= 100 &&
      std::abs(int{wanted.turn_ratio}) <= 100 && wanted.mode <= (kMotorOn | kBrake | kRegulated) &&
      wanted.regulation <= kRegulateSpeed &&
      (wanted.run_state == kIdle || wanted.run_state == kRunning);
  if (!known) return Error(kOutOfRange);
  for (size_t p = 0; p < ports_.size(); ++p) {
    if (port != p && port != kAllPorts) continue;
    wanted.block_zero = Counts(p, now);  // a new movement
    wanted.rotation_zero = ports_[p].rotation_zero;
    ports_[p] = wanted;
    if (static_cast<int>(p) == laser_.motor_port) Apply(ports_[p], now);
  }
  return Error(kOk);
}

void NxtBrick::Apply(const Port& port, RigTime now) {
  limit_at_ = kNever;
  if (stuck_) return unit_.motor().Drive(0, kBraking_s, now);
  if (port.run_state != kRunning || (port.mode & kMotorOn) == 0 || port.power == 0) {
    return Stop(now);
  }
  const bool regulated = (port.mode & kRegulated) != 0 && port.regulation == kRegulateSpeed;
  const double speed = laser_.full_speed_rad_s * port.power / 100 * (regulated ? 1 : kUnregulated);
  unit_.motor().Drive(speed, kRunUp_s, now);
  if (port.tacho_limit > 0) {
    const double limit = std::copysign(RadFromDeg(port.tacho_limit), speed);
    limit_at_ = unit_.motor().WhenAt(unit_.motor().Angle(now) + limit);
  }
  if (on_motor_) on_motor_(fmt::format("run {} %", port.power), now);
}

void NxtBrick::Stop(RigTime now) {
  const bool brakes = on_ && (ports_[laser_.motor_port].mode & kBrake) != 0;
  unit_.motor().Drive(0, brakes ? kBraking_s : kCoasting_s, now);
  if (on_motor_) on_motor_(brakes ? "brake" : "coast", now);
}

std::string NxtBrick::GetOutputState(RigTime now, std::string_view body) const {
  const auto p = static_cast<uint8_t>(body[0]);
  if (p >= ports_.size()) return Error(kOutOfRange) + std::string(22, '\0');
  const Port& port = ports_[p];
  const int32_t counts = Counts(p, now);
  ByteWriter out;
  out.Put<uint8_t>(kOk).Put(p).Put(port.power).Put(port.mode).Put(port.regulation);
  out.Put(port.turn_ratio).Put(port.run_state).Put(port.tacho_limit);
  out.Put(counts).Put(counts - port.block_zero).Put(counts - port.rotation_zero);
  return out.Take();
}

std::string NxtBrick::ResetMotorPosition(RigTime now, std::string_view body) {
  const auto p = static_cast<uint8_t>(body[0]);
  if (p >= ports_.size()) return Error(kOutOfRange);
  (body[1] != 0 ? ports_[p].block_zero : ports_[p].rotation_zero) = Counts(p, now);
  return Error(kOk);
}

int32_t NxtBrick::Counts(size_t port, RigTime now) const {
  if (static_cast<int>(port) != laser_.motor_port) return 0;
  const double degrees = std::fmod(DegFromRad(unit_.motor().Angle(now)), 1e9);
  return static_cast<int32_t>(std::lround(degrees));
}

uint16_t NxtBrick::BatteryMv(RigTime now) const {
  // A tenth of a volt an hour, down to what the brick still runs on.
  return static_cast<uint16_t>(std::max(6500.0, 8000 - Seconds(now) / 36));
}

void NxtBrick::SwitchOff(RigTime now) {
  if (!on_) return;
  on_ = false;
  sleep_at_ = limit_at_ = kNever;
  replies_.clear();
  for (Port& port : ports_) port = {};
  Stop(now);
  unit_.SetBrickOn(false, now);
  spdlog::info("nxt: switched off");
}

StatusOr<std::string> NxtBrick::Query(RigTime, std::string_view, sim_wire::Outbox&) {
  return InvalidArgument("the NXT brick answers no queries, only telegrams");
}

RigTime NxtBrick::NextEvent() const {
  return std::min({replies_.empty() ? kNever : replies_.front().first, limit_at_, sleep_at_});
}

void NxtBrick::RunEvent(RigTime now, sim_wire::Outbox& out) {
  if (now >= limit_at_) {
    limit_at_ = kNever;
    ports_[laser_.motor_port].run_state = kIdle;
    Stop(now);
  }
  while (!replies_.empty() && replies_.front().first <= now) {
    out.Send(std::move(replies_.front().second));
    replies_.pop_front();
  }
  if (now >= sleep_at_) SwitchOff(now);
}

Status NxtBrick::Inject(RigTime now, std::string_view text, sim_wire::Outbox&) {
  constexpr std::string_view kMount = "mount ";
  if (text.starts_with(kMount)) return unit_.Mount(text.substr(kMount.size()), now);
  if (text == "switch off") {
    SwitchOff(now);
  } else if (text == "switch on") {
    if (!on_) sleep_at_ = now + kSleepTime;
    on_ = true;
    unit_.SetBrickOn(true, now);
  } else if (text == "stuck" || text == "free") {
    stuck_ = text == "stuck";
    if (on_) Apply(ports_[static_cast<size_t>(laser_.motor_port)], now);
  } else {
    return InvalidArgument(
        "nxt: \"{}\" is not one of: mount NAME, switch off, switch on, stuck, free", text);
  }
  return OkStatus();
}

}  // namespace mesorig::simulator
