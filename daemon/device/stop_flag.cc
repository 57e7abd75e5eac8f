#include "daemon/device/stop_flag.h"

namespace mesorig::daemon {

void StopFlag::Raise(std::string_view reason) {
  clock_.Change([&] { RaiseInsideChange(reason); });
}

void StopFlag::RaiseInsideChange(std::string_view reason) {
  if (raised_) return;
  raised_ = true;
  reason_ = reason;
}

void StopFlag::LowerInsideChange() {
  raised_ = false;
  reason_.clear();
}

Status StopFlag::Check() const {
  Status status;
  clock_.Read([&] {
    if (raised_) status = Cancelled("{}", reason_);
  });
  return status;
}

Status StopFlag::Wait(RigTime deadline, const std::function<bool()>& ready) const {
  const bool done = clock_.WaitUntil(deadline, [&] { return raised_ || ready(); });
  MESORIG_RETURN_IF_ERROR(Check());
  return done ? OkStatus() : DeadlineExceeded("nothing until {:.3f} s", Seconds(deadline));
}

}  // namespace mesorig::daemon
