#include "daemon/drivers/nxt_laser/nxt_brick.h"

#include "protocol/base/bytes.h"

namespace mesorig::daemon::nxt_laser {
namespace {

constexpr RigTime kReplyLimit = std::chrono::seconds(1);
constexpr int kHaltAttempts = 3;
constexpr size_t kMostReplies = 8;  // that wait: one is owed, and late ones
constexpr uint8_t kWithReply = 0x00, kSystemWithReply = 0x01, kReply = 0x02;
enum Command : uint8_t {
  kSetOutputState = 0x04,
  kGetOutputState = 0x06,
  kResetMotorPosition = 0x0A,
  kGetBatteryLevel = 0x0B,
  kKeepAlive = 0x0D,
  kGetFirmwareVersion = 0x88,  // a system command
};
// SETOUTPUTSTATE: mode, regulation and run state.
constexpr uint8_t kMotorOn = 0x01, kBrake = 0x02, kRegulated = 0x04;
constexpr uint8_t kRegulationIdle = 0x00, kRegulateSpeed = 0x01;
constexpr uint8_t kRunIdle = 0x00, kRunRunning = 0x20;

ByteWriter Telegram(Command command, uint8_t type = kWithReply) {
  ByteWriter out;
  out.Put(type).Put(static_cast<uint8_t>(command));
  return out;
}

}  // namespace

NxtBrick::NxtBrick(RigClock& clock, UsbPort& port) : clock_(clock), port_(port), replies_(clock) {
  port_.OnPacket([this](RigTime, std::string packet) {
    if (replies_.SizeInsideChange() < kMostReplies) {
      replies_.PushInsideChange(std::move(packet));
    } else {
      ++unasked_;  // a device that never stops talking
    }
  });
}

NxtBrick::~NxtBrick() {
  port_.OnPacket([](RigTime, std::string) {});
}

NxtCounts NxtBrick::counts() const {
  NxtCounts counts = counts_;
  clock_.Read([&] { counts.unasked = unasked_; });
  return counts;
}

StatusOr<std::string> NxtBrick::Exchange(std::string_view what, std::string telegram, size_t size) {
  if (lost_command_ != 0) MESORIG_RETURN_IF_ERROR(Resync(std::exchange(lost_command_, 0)));
  return ExchangeOnce(what, telegram, size);
}

Status NxtBrick::Resync(char failed_command) {
  return failed_command == static_cast<char>(kKeepAlive)
             ? ExchangeOnce("reading the battery", Telegram(kGetBatteryLevel).Take(), 5).status()
             : ExchangeOnce("keep-alive", Telegram(kKeepAlive).Take(), 7).status();
}

StatusOr<std::string> NxtBrick::ExchangeOnce(std::string_view what, const std::string& telegram,
                                             size_t size) {
  const char command = telegram[1];
  replies_.Clear();  // what a reply of an earlier exchange left, which came too late
  MESORIG_RETURN_IF_ERROR(Annotate(port_.Write(telegram), fmt::format("NXT: {}", what)));
  const RigTime deadline = clock_.Now() + kReplyLimit;
  for (;;) {
    // The StopFlag does not end this: a stop goes through here.
    const auto reply = replies_.Pop(deadline);
    if (!reply) {
      ++counts_.unanswered;
      lost_command_ = command;
      return Unavailable("NXT: {}: no reply in {} s: the brick is off or its cable is out", what,
                         Seconds(kReplyLimit));
    }
    if (reply->size() < 3 || (*reply)[0] != static_cast<char>(kReply)) {
      ++counts_.damaged;
      lost_command_ = command;
      return Unavailable("NXT: {}: {} bytes that are no reply", what, reply->size());
    }
    if ((*reply)[1] != command) {  // late, of an earlier telegram
      ++counts_.foreign;
      continue;
    }
    if (const auto status = static_cast<uint8_t>((*reply)[2]); status != 0) {
      ++counts_.refused;
      return Unavailable("NXT: {}: the brick refuses with 0x{:02X}", what, status);
    }
    if (reply->size() != size) {
      ++counts_.damaged;
      return Unavailable("NXT: {}: a reply of {} bytes, {} expected", what, reply->size(), size);
    }
    return *reply;
  }
}

Status NxtBrick::Run(int motor, int power, uint32_t limit_deg) {
  ByteWriter out = Telegram(kSetOutputState);
  out.Put(static_cast<uint8_t>(motor)).Put(static_cast<int8_t>(power));
  out.Put<uint8_t>(kMotorOn | kBrake | kRegulated).Put(kRegulateSpeed);
  out.Put<int8_t>(0).Put(kRunRunning).Put(limit_deg);
  return Exchange("motor on", out.Take(), 3).status();
}

Status NxtBrick::Brake(int motor) {
  ByteWriter out = Telegram(kSetOutputState);
  out.Put(static_cast<uint8_t>(motor)).Put<int8_t>(0);
  out.Put<uint8_t>(kMotorOn | kBrake).Put(kRegulationIdle);
  out.Put<int8_t>(0).Put(kRunRunning).Put<uint32_t>(0);
  return Exchange("brake", out.Take(), 3).status();
}

Status NxtBrick::Halt(int motor) {
  ByteWriter out = Telegram(kSetOutputState);
  out.Put(static_cast<uint8_t>(motor)).Put<int8_t>(0);
  out.Put<uint8_t>(0).Put(kRegulationIdle);
  out.Put<int8_t>(0).Put(kRunIdle).Put<uint32_t>(0);
  const std::string telegram = out.Take();
  Status status;
  for (int attempt = 0; attempt < kHaltAttempts; ++attempt) {  // a stop is not given up at once
    status = Exchange("motor off", telegram, 3).status();
    if (status.ok()) return status;
  }
  return status;
}

Status NxtBrick::ResetPosition(int motor) {
  ByteWriter out = Telegram(kResetMotorPosition);
  out.Put(static_cast<uint8_t>(motor)).Put<uint8_t>(0);  // absolute
  return Exchange("reset of the position", out.Take(), 3).status();
}

StatusOr<OutputState> NxtBrick::GetOutput(int motor) {
  ByteWriter out = Telegram(kGetOutputState);
  out.Put(static_cast<uint8_t>(motor));
  MESORIG_ASSIGN_OR_RETURN(const std::string reply, Exchange("reading the motor", out.Take(), 25));
  ByteReader in(std::string_view(reply).substr(3));
  const auto port = in.Get<uint8_t>();
  OutputState state;
  state.power = in.Get<int8_t>();
  (void)in.Get<uint8_t>();  // mode
  (void)in.Get<uint8_t>();  // regulation
  (void)in.Get<int8_t>();   // turn ratio
  state.running = in.Get<uint8_t>() != kRunIdle;
  (void)in.Get<uint32_t>();  // tacho limit
  state.tacho_deg = in.Get<int32_t>();
  (void)in.Get<int32_t>();   // block tacho count
  state.rotation_deg = in.Get<int32_t>();
  if (port != motor) return Unavailable("NXT: motor {} answered, {} was asked", port, motor);
  return state;
}

StatusOr<double> NxtBrick::BatteryVolts() {
  MESORIG_ASSIGN_OR_RETURN(const std::string reply,
                           Exchange("reading the battery", Telegram(kGetBatteryLevel).Take(), 5));
  return ByteReader(std::string_view(reply).substr(3)).Get<uint16_t>() * 1e-3;
}

StatusOr<Versions> NxtBrick::ReadVersions() {
  MESORIG_ASSIGN_OR_RETURN(
      const std::string reply,
      Exchange("reading the versions", Telegram(kGetFirmwareVersion, kSystemWithReply).Take(), 7));
  ByteReader in(std::string_view(reply).substr(3));
  Versions versions;
  versions.protocol_minor = in.Get<uint8_t>();
  versions.protocol_major = in.Get<uint8_t>();
  versions.firmware_minor = in.Get<uint8_t>();
  versions.firmware_major = in.Get<uint8_t>();
  return versions;
}

StatusOr<double> NxtBrick::KeepAlive() {
  MESORIG_ASSIGN_OR_RETURN(const std::string reply,
                           Exchange("keep-alive", Telegram(kKeepAlive).Take(), 7));
  return ByteReader(std::string_view(reply).substr(3)).Get<uint32_t>() * 1e-3;
}

}  // namespace mesorig::daemon::nxt_laser
