// What an NXT brick answers, to the driver of the laser's emitter: for each telegram of the driver
// a byte that says how many packets come (0 to 3) and how far they look like its reply, then each
// packet's length and bytes. Whatever they say, every call ends in time, no angle that is none is
// handed out, no motor is driven beyond full power, and after a stop that succeeded the last word
// was "off".

#include <cmath>

#include "daemon/drivers/driver.h"
#include "tests/daemon/fakes/fake_rig_clock.h"
#include "tests/daemon/fakes/small_rig.h"
#include "tests/fuzz/fuzz_target.h"

namespace mesorig::daemon {
namespace {

constexpr uint8_t kSetOutputState = 0x04;

// Of the reply to a telegram of this command.
size_t SizeOfReply(uint8_t command) {
  switch (command) {
    case 0x06:
      return 25;
    case 0x0B:
      return 5;
    case 0x0D:
    case 0x88:
      return 7;
    default:
      return 3;
  }
}

class LyingBrick final : public UsbPort {
 public:
  LyingBrick(RigClock& clock, std::string_view script) : clock_(clock), script_(script) {}
  Status Write(std::string_view telegram) override {
    MESORIG_CHECK(telegram.size() >= 2 && telegram.size() <= 64);
    if (static_cast<uint8_t>(telegram[1]) == kSetOutputState) {
      MESORIG_CHECK(std::abs(int{static_cast<int8_t>(telegram[3])}) <= 100);
      last_output = telegram;
    }
    const uint8_t how = Take();
    if (how == 0xFF) return Unavailable("unplugged");
    for (int k = 0; k < how % 4; ++k) {
      std::string packet(script_.substr(0, Take() % 65));
      script_.remove_prefix(packet.size());
      if ((how & 16) != 0) packet.resize(SizeOfReply(static_cast<uint8_t>(telegram[1])), 1);
      if ((how & 4) != 0 && packet.size() >= 3) {
        packet[0] = 2, packet[1] = telegram[1];
        if ((how & 8) != 0) packet[2] = 0;
      }
      clock_.Change([&] { handler_(RigTime{}, packet); });
    }
    return OkStatus();
  }
  void OnPacket(std::function<void(RigTime, std::string)> handler) override {
    handler_ = std::move(handler);
  }
  std::string last_output;

 private:
  uint8_t Take() {
    if (script_.empty()) return 0;
    const auto byte = static_cast<uint8_t>(script_[0]);
    script_.remove_prefix(1);
    return byte;
  }
  RigClock& clock_;
  std::string_view script_;
  std::function<void(RigTime, std::string)> handler_;
};

void Drive(std::string_view script) {
  static const Rig rig = SmallLaserRig();
  FakeRigClock clock;
  RigClock::Member member(clock, "fuzz");
  RigClock::Activity activity(clock, Pace::kFree);
  StopFlag stop(clock);
  LyingBrick brick(clock, script);
  DriverContext context;
  context.clock = &clock, context.rig = &rig, context.stop = &stop, context.usb = &brick;
  const auto laser = MakeLineLaser("nxt_laser", context).value();
  (void)laser->Open();
  (void)laser->MarkZero();
  if (laser->Prepare(0.01, 0.01).ok() && laser->StartSweep(0.01).ok()) {
    (void)laser->AwaitTilt(0.01, clock.Now() + std::chrono::seconds(2));
  }
  const auto reading = laser->Read();
  MESORIG_CHECK(!reading.ok() || std::isfinite(reading->tilt_rad));
  (void)laser->KeepAlive();
  if (laser->Stop().ok()) {
    MESORIG_CHECK(brick.last_output[3] == 0 && brick.last_output[4] == 0 &&
                  brick.last_output[7] == 0);
  }
  // Travels try a few times, exchanges a second: minutes of the rig's time, not hours.
  MESORIG_CHECK(clock.Now() < std::chrono::hours(1));
}

}  // namespace
}  // namespace mesorig::daemon

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  mesorig::daemon::Drive(mesorig::fuzz::View(data, size));
  return 0;
}
