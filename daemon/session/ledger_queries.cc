// What is asked of a journal.

#include <sqlite3.h>

#include <algorithm>

#include "daemon/session/ledger.h"
#include "daemon/session/ledger_rows.h"
#include "daemon/session/sqlite_statement.h"

namespace mesorig::daemon {

StatusOr<SessionSummary> Ledger::ReadSummary() {
  Statement query(db_,
                  "SELECT id, plan_name, plan_sha256, rig_sha256, frames_planned, end, reason, "
                  "deterministic, virtual_s, wall_s, sample_name, sample_sha256, starts, "
                  "(SELECT count(*) FROM frame) FROM session");
  const int step = query.Step();
  if (step == SQLITE_DONE) return DataLoss("{}: has no session record", path_.string());
  if (step != SQLITE_ROW) return Error("reading the session record");
  Columns columns(query.get());
  SessionSummary s;
  s.id = columns.Text();
  s.plan_name = columns.Text();
  s.plan_sha256 = columns.Text();
  s.rig_sha256 = columns.Text();
  s.frames_planned = static_cast<uint32_t>(columns.Int());
  const int64_t end = columns.Int();
  if (end < 0 || end > static_cast<int>(SessionEnd::kIncomplete)) {
    return DataLoss("{}: the session's end is {}, not in [0, 2]", path_.string(), end);
  }
  s.end = static_cast<SessionEnd>(end);
  s.reason = columns.Text();
  s.deterministic = columns.Int() != 0;
  s.virtual_s = columns.Real();
  s.wall_s = columns.Real();
  s.sample_name = columns.Text();
  s.sample_sha256 = columns.Text();
  s.starts = static_cast<uint32_t>(columns.Int());
  s.frames_durable = static_cast<uint32_t>(columns.Int());
  return s;
}

StatusOr<std::vector<JournalEntry>> Ledger::ReadEntries() {
  std::vector<JournalEntry> entries;
  Statement query(db_, "SELECT kind, rig_ns, item, value, text FROM entry ORDER BY number");
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    Columns columns(query.get());
    JournalEntry entry;
    entry.kind = static_cast<JournalKind>(columns.Int());
    entry.rig_ns = columns.Int();
    entry.index = static_cast<int>(columns.Int());
    entry.value = columns.Real();
    entry.text = columns.Text();
    entries.push_back(std::move(entry));
  }
  if (step != SQLITE_DONE) return Error("reading the journal's entries");
  return entries;
}

StatusOr<std::optional<FrameRecord>> Ledger::Find(int camera, uint64_t sequence) {
  if (find_ == nullptr) {
    const std::string sql =
        fmt::format("SELECT {} FROM frame WHERE camera=? AND sequence=?", kFrameColumns);
    if (sqlite3_prepare_v2(db_, sql.c_str(), -1, &find_, nullptr) != SQLITE_OK) {
      return Error("preparing a ledger look-up");
    }
  }
  Binder(find_).Int(camera).Int(static_cast<int64_t>(sequence));
  const int step = sqlite3_step(find_);
  StatusOr<std::optional<FrameRecord>> found = std::optional<FrameRecord>();
  if (step == SQLITE_ROW) {
    found = std::optional<FrameRecord>(ReadFrame(find_));
  } else if (step != SQLITE_DONE) {
    found = Error(fmt::format("reading ledger row {} of camera {}", sequence, camera));
  }
  sqlite3_reset(find_);  // also ends the read transaction
  return found;
}

StatusOr<uint64_t> Ledger::LastOfShot(int camera, uint32_t shot) {
  Statement query(db_, "SELECT coalesce(max(sequence), 0) FROM frame WHERE camera=? AND shot=?");
  Binder(query.get()).Int(camera).Int(shot);
  if (query.Step() != SQLITE_ROW) return Error("looking for the row of a shot");
  return static_cast<uint64_t>(Columns(query.get()).Int());
}

StatusOr<uint64_t> Ledger::LastOfStretch(const FrameRecord& row) {
  Statement query(db_,
                  "SELECT coalesce("
                  "(SELECT min(sequence) - 1 FROM frame WHERE camera=?1 AND sequence>?2 AND "
                  "segment<>?3), (SELECT max(sequence) FROM frame WHERE camera=?1), ?2)");
  Binder(query.get()).Int(row.camera).Int(static_cast<int64_t>(row.sequence)).Int(row.segment);
  if (query.Step() != SQLITE_ROW) return Error("reading the rows of a released sweep");
  // (A damaged index could answer with less, and its caller would not come on.)
  return std::max(row.sequence, static_cast<uint64_t>(Columns(query.get()).Int()));
}

StatusOr<Ledger::Coverage> Ledger::Cover(int camera, uint32_t segment, uint32_t first,
                                         uint32_t count) {
  Statement query(db_,
                  "SELECT count(DISTINCT shot), coalesce(max(offset + bytes), 0) FROM frame "
                  "WHERE camera=? AND segment=? AND shot>=? AND shot<?");
  Binder(query.get()).Int(camera).Int(segment).Int(first).Int(int64_t{first} + count);
  if (query.Step() != SQLITE_ROW) return Error("counting the rows of a sweep");
  Columns columns(query.get());
  Coverage coverage;
  coverage.shots = static_cast<uint32_t>(columns.Int());
  coverage.last_bytes = static_cast<uint64_t>(columns.Int());
  return coverage;
}

StatusOr<std::vector<uint64_t>> Ledger::LastSequences(int cameras) {
  std::vector<uint64_t> last(static_cast<size_t>(cameras), 0);
  for (int camera = 0; camera < cameras; ++camera) {
    Statement query(db_, "SELECT coalesce(max(sequence), 0) FROM frame WHERE camera=?");
    Binder(query.get()).Int(camera);
    if (query.Step() != SQLITE_ROW) return Error("counting the ledger's rows");
    last[static_cast<size_t>(camera)] = static_cast<uint64_t>(Columns(query.get()).Int());
  }
  Statement strangers(db_,
                      "SELECT coalesce((SELECT min(camera) FROM frame), 0), "
                      "coalesce((SELECT max(camera) FROM frame), 0)");
  if (strangers.Step() != SQLITE_ROW) return Error("counting the ledger's rows");
  Columns columns(strangers.get());
  const int64_t lowest = columns.Int(), highest = columns.Int();
  if (lowest < 0 || (highest > 0 && highest >= cameras)) {
    return DataLoss("{}: has frames of camera {}, the rig has {}", path_.string(),
                    lowest < 0 ? lowest : highest, cameras);
  }
  return last;
}

Status Ledger::ForEachPlace(const std::function<Status(const Place&)>& visit) {
  Statement query(db_,
                  "SELECT camera, sequence, shot, segment, offset, bytes FROM frame "
                  "ORDER BY camera, sequence");
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    Columns columns(query.get());
    Place place;
    place.camera = static_cast<int>(columns.Int());
    place.sequence = static_cast<uint64_t>(columns.Int());
    place.shot = static_cast<uint32_t>(columns.Int());
    place.segment = static_cast<uint32_t>(columns.Int());
    place.offset = static_cast<uint64_t>(columns.Int());
    place.bytes = static_cast<uint64_t>(columns.Int());
    MESORIG_RETURN_IF_ERROR(visit(place));
  }
  if (step != SQLITE_DONE) return Error("reading the ledger");
  return OkStatus();
}

Status Ledger::ForEach(const std::function<Status(const FrameRecord&)>& visit) {
  Statement query(db_,
                  fmt::format("SELECT {} FROM frame ORDER BY camera, sequence", kFrameColumns));
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    MESORIG_RETURN_IF_ERROR(visit(ReadFrame(query.get())));
  }
  if (step != SQLITE_DONE) return Error("reading the ledger");
  return OkStatus();
}

Status Ledger::ForEachLive(const std::function<Status(const FrameRecord&)>& visit) {
  // (By the index frame_of_shot: nothing is sorted, nothing kept.)
  Statement query(db_,
                  fmt::format("SELECT {} FROM frame AS f WHERE NOT EXISTS (SELECT 1 FROM frame AS "
                              "later WHERE later.camera=f.camera AND later.shot=f.shot AND "
                              "later.sequence>f.sequence) ORDER BY camera, shot",
                              kFrameColumns));
  int step = 0;
  while ((step = query.Step()) == SQLITE_ROW) {
    MESORIG_RETURN_IF_ERROR(visit(ReadFrame(query.get())));
  }
  if (step != SQLITE_DONE) return Error("reading the ledger");
  return OkStatus();
}

}  // namespace mesorig::daemon
