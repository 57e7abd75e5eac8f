#pragma once
// The rig's devices as plans and manual control see them: what would energise asks Safety first and
// is counted there, what takes energy away always passes. Each borrows its device and Safety.

#include "daemon/safety/safety.h"

namespace mesorig::daemon {

class AxisGuard final : public Axis {
 public:
  AxisGuard(Safety& safety, Axis& axis, size_t index)
      : safety_(safety), axis_(axis), index_(index) {}
  const std::string& name() const override { return axis_.name(); }
  // FailedPrecondition: Safety says no, beside the axis' own errors. StartHoming and StartMove also
  // while the laser shines or may.
  Status Enable() override;
  Status StartHoming() override;
  Status StartMove(double target_rad) override;
  Status SetSpeed(double rad_s) override { return axis_.SetSpeed(rad_s); }
  Status Disable() override;
  Status AwaitHoming(RigTime deadline) override;
  Status AwaitMove(RigTime deadline) override;
  Status CheckHolds() const override { return axis_.CheckHolds(); }
  Status QuickStop() override { return axis_.QuickStop(); }
  AxisReading Read() const override { return axis_.Read(); }

 private:
  Status MayMove();
  Safety& safety_;
  Axis& axis_;
  const size_t index_;
};

class LampGuard final : public LampBank {
 public:
  LampGuard(Safety& safety, LampBank& lamps, const Rig& rig)
      : safety_(safety), lamps_(lamps), rig_(rig) {}
  Status Open() override { return lamps_.Open(); }
  Status SwitchTo(int channel) override;
  StatusOr<std::vector<double>> ReadLevels() override;
  StatusOr<LampReadings> Watch() override { return lamps_.Watch(); }
  Status AllOff() override;

 private:
  Status WentDark(Status off);

  Safety& safety_;
  LampBank& lamps_;
  const Rig& rig_;
};

}  // namespace mesorig::daemon
