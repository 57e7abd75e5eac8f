#include "daemon/control/reading_board.h"

namespace mesorig::daemon {

ReadingBoard::ReadingBoard(const Rig& rig) : axes_(rig.axes.size()), lamps_(rig.lamps.size()) {
  const MutexLock lock(mutex_);
  for (const auto& axis : rig.axes) slots_.push_back({{axis.name, "rad", 0, {}}});
  for (const auto& lamp : rig.lamps) slots_.push_back({{lamp.name, "1", 0, {}}});
  slots_.push_back({{"estop", "closed", 0, {}}});
  slots_.push_back({{"door", "closed", 0, {}}});
}

void ReadingBoard::Set(size_t slot, double value, RigTime read_at) {
  slots_[slot].reading.value = value;
  slots_[slot].reading.read_at = read_at;
  slots_[slot].read = true;
}

void ReadingBoard::SetAxis(size_t axis, const AxisReading& reading) {
  const MutexLock lock(mutex_);
  Set(axis, reading.position_rad, reading.read_at);
}

void ReadingBoard::SetLevels(const std::vector<double>& levels, RigTime read_at) {
  const MutexLock lock(mutex_);
  for (size_t i = 0; i < std::min(levels.size(), lamps_); ++i) Set(axes_ + i, levels[i], read_at);
}

void ReadingBoard::SetChain(const InterlockChain::Levels& levels) {
  const MutexLock lock(mutex_);
  Set(axes_ + lamps_, levels.estop ? 1 : 0, levels.read_at);
  Set(axes_ + lamps_ + 1, levels.door ? 1 : 0, levels.read_at);
}

void ReadingBoard::Count(const FrameTrouble& more) {
  const MutexLock lock(mutex_);
  trouble_.late += more.late;
  trouble_.lost += more.lost;
  trouble_.refused += more.refused;
}

FrameTrouble ReadingBoard::trouble() const {
  const MutexLock lock(mutex_);
  return trouble_;
}

std::vector<Reading> ReadingBoard::Get() const {
  const MutexLock lock(mutex_);
  std::vector<Reading> readings;
  for (const Slot& slot : slots_) {
    if (slot.read) readings.push_back(slot.reading);
  }
  return readings;
}

}  // namespace mesorig::daemon
