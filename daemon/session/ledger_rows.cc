#include "daemon/session/ledger_rows.h"

#include "daemon/session/sqlite_statement.h"

namespace mesorig::daemon {
namespace {

// Frames without laser have NULL in all its columns.
void BindLaser(Binder& binder, const std::optional<LaserRecord>& laser) {
  if (!laser) {
    binder.Null().Null().Null().Null().Null();
    return;
  }
  binder.Int(laser->sweep).Int(laser->index).Int(laser->mount).Real(laser->tilt_rad);
  binder.Int(laser->on);
}

std::optional<LaserRecord> ReadLaser(Columns& columns) {
  const bool none = columns.IsNull();
  LaserRecord laser;
  laser.sweep = static_cast<uint32_t>(columns.Int());
  laser.index = static_cast<uint32_t>(columns.Int());
  laser.mount = static_cast<int>(columns.Int());
  laser.tilt_rad = columns.Real();
  laser.on = columns.Int() != 0;
  if (none) return std::nullopt;
  return laser;
}

}  // namespace

void BindFrame(sqlite3_stmt* statement, const FrameRecord& r) {
  Binder binder(statement);
  binder.Int(r.camera)
      .Int(static_cast<int64_t>(r.sequence))
      .Int(r.shot)
      .Int(r.trigger_id)
      .Int(static_cast<int64_t>(r.frame_id))
      .Int(static_cast<int64_t>(r.supersedes))
      .Int(r.exposure_start_ns)
      .Int(r.exposure_end_ns)
      .Real(r.exposure_s)
      .Doubles(r.axis_rad)
      .Doubles(r.lamp_level)
      .Int(r.width)
      .Int(r.height)
      .Int(r.bits)
      .Int(r.region_x)
      .Int(r.region_y);
  BindLaser(binder, r.laser);
  binder.Text(r.digest)
      .Int(r.segment)
      .Int(static_cast<int64_t>(r.offset))
      .Int(static_cast<int64_t>(r.bytes))
      .Int(r.run);
}

FrameRecord ReadFrame(sqlite3_stmt* row) {
  Columns columns(row);
  FrameRecord r;
  r.camera = static_cast<int>(columns.Int());
  r.sequence = static_cast<uint64_t>(columns.Int());
  r.shot = static_cast<uint32_t>(columns.Int());
  r.trigger_id = static_cast<uint32_t>(columns.Int());
  r.frame_id = static_cast<uint64_t>(columns.Int());
  r.supersedes = static_cast<uint64_t>(columns.Int());
  r.exposure_start_ns = columns.Int();
  r.exposure_end_ns = columns.Int();
  r.exposure_s = columns.Real();
  r.axis_rad = columns.Doubles();
  r.lamp_level = columns.Doubles();
  r.width = static_cast<int>(columns.Int());
  r.height = static_cast<int>(columns.Int());
  r.bits = static_cast<int>(columns.Int());
  r.region_x = static_cast<int>(columns.Int());
  r.region_y = static_cast<int>(columns.Int());
  r.laser = ReadLaser(columns);
  r.digest = columns.Text();
  r.segment = static_cast<uint32_t>(columns.Int());
  r.offset = static_cast<uint64_t>(columns.Int());
  r.bytes = static_cast<uint64_t>(columns.Int());
  r.run = static_cast<uint32_t>(columns.Int());
  return r;
}

}  // namespace mesorig::daemon
