#include "daemon/control/rig_stance.h"

#include <algorithm>
#include <cmath>

namespace mesorig::daemon {
namespace {

constexpr double kMoveMargin_s = 5;
// Light is steady: this near to full (or to dark), and two readings this near to each other: the
// bank reads whole per mille, and the first of the two is taken an eighth of the settling time
// before.
constexpr double kSteadyLevel = 0.002, kSteadyChange = 0.0025;
constexpr int kPollsPerSettle = 8, kSettleTimes = 4;
// A lamp that lost this much between settling and the shot went off (supply, communication loss).
constexpr double kLostLevel = 0.02;

}  // namespace

RigStance::RigStance(const RunContext& context)
    : context_(context), axes_(context.devices.axes.size()) {}

void RigStance::Forget() {
  std::fill(axes_.begin(), axes_.end(), AxisState());
  lamp_.reset();
  steady_ = false;
}

Status RigStance::Wait(RigTime until) const {
  const Status waited = context_.devices.stop->Wait(until, [] { return false; });
  return absl::IsCancelled(waited) ? waited : OkStatus();
}

Status RigStance::Begin(const Stance& wanted) {
  // The lamp first: its command takes no rig time, those of the axes do.
  MESORIG_RETURN_IF_ERROR(SwitchLamp(wanted.lamp));
  return StartAxes(wanted.axis_rad);
}

Status RigStance::Reach(const Stance& wanted) {
  MESORIG_RETURN_IF_ERROR(Begin(wanted));
  // In this order: light is read at set times, axes say themselves when they arrived.
  MESORIG_RETURN_IF_ERROR(AwaitLight());
  MESORIG_RETURN_IF_ERROR(AwaitAxes());
  return Wait(std::max(rested_, arrived_ + FromSeconds(wanted.settle_s)));
}

Status RigStance::StartAxes(const std::vector<double>& axis_rad) {
  std::vector<size_t> starting;
  for (size_t i = 0; i < axis_rad.size(); ++i) {
    if (axes_[i].target_rad != axis_rad[i]) starting.push_back(i);
  }
  for (const size_t i : starting) {
    Axis& axis = *context_.devices.axes[i];
    AxisState& state = axes_[i];
    if (state.moving) {  // elsewhere: a shot before it is owed again
      MESORIG_RETURN_IF_ERROR(axis.AwaitMove(state.deadline));
      state.moving = false;
    }
    const double distance = axis_rad[i] - axis.Read().position_rad;
    state.target_rad.reset();
    MESORIG_RETURN_IF_ERROR(axis.StartMove(axis_rad[i]));
    state = {axis_rad[i], true,
             context_.clock.Now() +
                 FromSeconds(MoveSeconds(context_.rig.axes[i], distance) + kMoveMargin_s)};
  }
  return OkStatus();
}

Status RigStance::AwaitAxes() {
  bool moved = false;
  for (size_t i = 0; i < axes_.size(); ++i) {
    if (!axes_[i].moving) continue;
    const Status there = context_.devices.axes[i]->AwaitMove(axes_[i].deadline);
    if (!there.ok()) {
      axes_[i].target_rad.reset();
      return there;
    }
    axes_[i].moving = false;
    moved = true;
    const RigTime at = context_.devices.axes[i]->Read().read_at;
    arrived_ = std::max(arrived_, at);
    // (A resumed plan moves axes that its own order would have left where they are.)
    rested_ = std::max(rested_, at + FromSeconds(context_.rig.axes[i].settle_s));
  }
  if (moved) ReadAxes();
  return OkStatus();
}

Status RigStance::SwitchLamp(int lamp) {
  if (lamp_ == lamp) return OkStatus();
  lamp_.reset();
  steady_ = false;
  const auto& lamps = context_.rig.lamps;
  MESORIG_RETURN_IF_ERROR(context_.devices.lamps->SwitchTo(lamp < 0 ? -1 : lamps[lamp].channel));
  lamp_ = lamp;
  switched_ = context_.clock.Now();
  return OkStatus();
}

bool RigStance::Steady(const std::vector<double>& levels) const {
  if (levels.size() != context_.rig.lamps.size()) return false;  // no reading yet
  for (size_t i = 0; i < levels.size(); ++i) {
    const double wanted = static_cast<int>(i) == *lamp_ ? 1 : 0;
    if (!(std::abs(levels[i] - wanted) <= kSteadyLevel)) return false;
  }
  return true;
}

// Measures instead of sleeping: steady light has had the rig's settling time, and two readings in a
// row say that it is there.
Status RigStance::AwaitLight() {
  if (steady_) return OkStatus();
  const auto& lamps = context_.rig.lamps;
  double settle_s = 0;  // lamps that go off count too
  for (const auto& each : lamps) settle_s = std::max(settle_s, each.settle_s);
  // From shortly before that time on, or from now: a long way of the laser may have come between.
  const RigTime step = FromSeconds(settle_s / kPollsPerSettle);
  RigTime due = std::max(switched_ + (kPollsPerSettle - 1) * step, context_.clock.Now());
  std::vector<double> last, levels;
  for (int poll = kPollsPerSettle - 1; poll <= kPollsPerSettle * kSettleTimes; ++poll) {
    MESORIG_RETURN_IF_ERROR(Wait(due));
    due += step;
    last = std::move(levels);
    MESORIG_ASSIGN_OR_RETURN(levels, ReadLevels());
    if (context_.clock.Now() < switched_ + FromSeconds(settle_s)) continue;
    if (!Steady(levels) || !Steady(last)) continue;
    double change = 0;
    for (size_t i = 0; i < levels.size(); ++i) {
      change = std::max(change, std::abs(levels[i] - last[i]));
    }
    if (change > kSteadyChange) continue;
    steady_ = true;
    return OkStatus();
  }
  std::string read_back;
  for (const double level : levels) read_back += fmt::format(" {:.3f}", level);
  const std::string what = *lamp_ < 0 ? "all lamps off" : "lamp " + lamps[*lamp_].name;
  lamp_.reset();
  return Unavailable("{}: light not steady after {:.3f} s; levels read back:{}", what,
                     settle_s * kSettleTimes, read_back);
}

Status RigStance::CheckHolds() const {
  for (const Axis* axis : context_.devices.axes) MESORIG_RETURN_IF_ERROR(axis->CheckHolds());
  return OkStatus();
}

std::vector<double> RigStance::ReadAxes() {
  std::vector<double> positions;
  for (size_t i = 0; i < context_.devices.axes.size(); ++i) {
    const AxisReading reading = context_.devices.axes[i]->Read();
    context_.board.SetAxis(i, reading);
    positions.push_back(reading.position_rad);
  }
  return positions;
}

StatusOr<std::vector<double>> RigStance::ReadLevels() {
  MESORIG_ASSIGN_OR_RETURN(auto levels, context_.devices.lamps->ReadLevels());
  if (levels.size() != context_.rig.lamps.size()) {
    return Internal("lamp bank: {} levels of {} lamps", levels.size(), context_.rig.lamps.size());
  }
  context_.board.SetLevels(levels, context_.clock.Now());
  return levels;
}

Status RigStance::CheckLit(const std::vector<double>& levels) const {
  if (!lamp_ || *lamp_ < 0 || levels[*lamp_] >= 1 - kLostLevel) return OkStatus();
  return Unavailable("lamp {}: level {:.3f} at the shot, 1 wanted", context_.rig.lamps[*lamp_].name,
                     levels[*lamp_]);
}

}  // namespace mesorig::daemon
