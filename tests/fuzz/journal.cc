// journal.sqlite: any bytes as the file or, after a first line `sql`, the journal of a small
// session that these statements were run on. Refused, damaged or read: never a crash.

#include <sqlite3.h>

#include "daemon/session/ledger.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/journal_sql.h"

namespace mesorig::daemon {
namespace {

constexpr int kMaxRows = 10'000;

void WriteSmallJournal(const std::filesystem::path& path) {
  SessionSummary session;
  session.id = "20260101T000000.000Z-small", session.plan_name = "small";
  session.frames_planned = 6;
  const auto ledger = Ledger::Create(path, session).value();
  std::vector<FrameRecord> rows;
  for (uint32_t i = 0; i < 6; ++i) {
    FrameRecord& row = rows.emplace_back();
    row.camera = static_cast<int>(i % 2), row.sequence = i / 2 + 1, row.shot = i / 2;
    row.width = 8, row.height = 8, row.bits = 12, row.bytes = 128, row.offset = 40 + 200 * (i / 2);
    row.axis_rad = {0.5, -0.5}, row.lamp_level = {0, 1};
    row.digest = "0123456789abcdef0123456789abcdef";
    if (i > 3) row.laser = LaserRecord{0, i - 4, 0, 0.01, true};
  }
  MESORIG_CHECK(ledger->Commit(rows, {{JournalKind::kNote, 5, 1, 0.5, "note"}}).ok() &&
                ledger->Checkpoint().ok());
}

void ReadAll(Ledger& ledger) {
  (void)ledger.ReadSummary();
  (void)ledger.ReadEntries();
  (void)ledger.LastSequences(8);
  (void)ledger.ForEachPlace([](const Ledger::Place&) { return OkStatus(); });
  (void)ledger.ForEachLive([](const FrameRecord&) { return OkStatus(); });
  int rows = 0;
  (void)ledger.ForEach([&](const FrameRecord& row) -> Status {
    if (rows < 8) {
      (void)ledger.Find(row.camera, row.sequence);
      (void)ledger.LastOfStretch(row);
      (void)ledger.LastOfShot(row.camera, row.shot);
      (void)ledger.Cover(row.camera, row.segment, row.shot, 4);
    }
    return ++rows < kMaxRows ? OkStatus() : Cancelled("enough");
  });
}

}  // namespace
}  // namespace mesorig::daemon

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const fuzz::ScratchFolder scratch;
  static const auto small = [] {
    daemon::WriteSmallJournal(scratch.path() / "small.sqlite");
    return scratch.path() / "small.sqlite";
  }();
  const auto path = scratch.path() / "journal.sqlite";
  std::string_view bytes = fuzz::View(data, size);
  if (bytes.starts_with("sql\n")) {
    std::filesystem::copy_file(small, path, std::filesystem::copy_options::overwrite_existing);
    fuzz::RunSql(path, bytes.substr(4));
  } else {
    fuzz::Overwrite(path, bytes);
  }
  if (const auto ledger = daemon::Ledger::Open(path); ledger.ok()) daemon::ReadAll(**ledger);
  for (const char* suffix : {"-wal", "-shm", "-journal"}) {
    std::filesystem::remove(path.string() + suffix);
  }
  return 0;
}
