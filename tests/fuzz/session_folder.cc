// A session's folder after an accident. The input is text, a line a deed, done to a whole session
// of 8 cameras with sweeps:
//   FILE cut BYTES           the file ends there
//   FILE set OFFSET TEXT     these bytes there (offsets beyond the end count from the beginning)
//   FILE flip OFFSET BITS    one byte, exclusive or
//   FILE remove
//   FILE fill TEXT           the whole file
//   sql STATEMENTS           on the journal
// Opened then as a reader and as the daemon do: what is handed out is what was written.

#include <charconv>
#include <map>

#include "daemon/session/housekeeping.h"
#include "daemon/session/verify.h"
#include "protocol/base/digest.h"
#include "tests/daemon/session/session_fixture.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/journal_sql.h"

namespace mesorig::daemon {
namespace {

constexpr size_t kMaxBytes = 1 << 20;
constexpr int kMaxFrames = 200;

size_t TakeNumber(std::string_view& text) {
  const std::string_view word = fuzz::TakeUntil(text, " ");
  size_t number = 0;
  std::from_chars(word.data(), word.data() + word.size(), number);
  return number;
}

class Victim {
 public:
  Victim() {
    auto session = Session::Create(scratch_.path() / "whole", plan_, rig_).value();
    MESORIG_CHECK(AppendAll(*session, plan_).ok());
    MESORIG_CHECK(session->Finish(false, "killed", 1, 1, true).ok());
    id_ = session->id();
    session.reset();
    for (const auto& entry : std::filesystem::recursive_directory_iterator(scratch_.path())) {
      if (!entry.is_regular_file()) continue;
      const auto name = std::filesystem::relative(entry.path(), scratch_.path() / "whole" / id_);
      whole_[name.string()] = ReadFile(entry.path()).value();
    }
  }

  void Restore() {
    std::error_code ignored;
    std::filesystem::remove_all(root(), ignored);
    std::filesystem::create_directories(root() / id_ / "sweeps");
    for (const auto& [name, bytes] : whole_) fuzz::Overwrite(root() / id_ / name, bytes);
  }

  void Do(std::string_view deed) {
    const std::string file(fuzz::TakeUntil(deed, " "));
    const auto path = root() / id_ / file;
    if (file == "sql") return fuzz::RunSql(root() / id_ / "journal.sqlite", deed);
    const auto found = whole_.find(file);
    if (found == whole_.end() && !IsMark(file)) return;
    std::string bytes = ReadFile(path).value_or("");
    const std::string_view verb = fuzz::TakeUntil(deed, " ");
    std::error_code ignored;
    if (verb == "remove") std::filesystem::remove(path, ignored);
    if (verb == "fill") fuzz::Overwrite(path, deed);
    if (verb == "cut") bytes.resize(std::min(TakeNumber(deed), kMaxBytes));
    if (verb == "set" || verb == "flip") {
      const size_t at = TakeNumber(deed) % (bytes.size() + 1);
      if (verb == "set") bytes.replace(at, deed.size(), deed);
      if (verb == "flip" && at < bytes.size()) bytes[at] ^= static_cast<char>(TakeNumber(deed));
    }
    if (verb == "cut" || verb == "set" || verb == "flip") fuzz::Overwrite(path, bytes);
  }

  void Read(Session& session) {
    (void)session.Summary();
    for (int camera = -1; camera < 9; ++camera) {
      uint64_t cursor = 0;
      for (int i = 0; i < kMaxFrames; ++i) {
        const auto frame = session.Next(camera, cursor, 0);
        if (!frame.ok()) {
          ++cursor;  // the next ones may be whole
          if (i > 40) break;
        } else if (!frame->has_value()) {
          break;
        } else {
          const FrameRecord& row = (*frame)->record;
          MESORIG_CHECK(row.sequence > cursor);
          MESORIG_CHECK((*frame)->pixels->size() == row.bytes);
          MESORIG_CHECK(FrameDigest(*(*frame)->pixels) == row.digest);
          cursor = row.sequence;
        }
      }
    }
  }

  void Open() {
    if (auto session = Session::Open(root(), id_); session.ok()) {
      Read(**session);
      for (uint32_t sweep = 0; sweep < 4; ++sweep) (void)(*session)->ReleaseSweep(sweep);
      Read(**session);
    }
    (void)DescribeSession(root(), id_);
    (void)VerifySession(root(), id_, [](uint32_t, uint32_t) { return true; });
    auto session = Session::Resume(root(), id_, rig_);
    if (!session.ok()) return;
    for (uint32_t shot = 0; shot <= plan_.shots; ++shot) {
      for (const int camera : (*session)->Missing(shot)) {
        MESORIG_CHECK(camera >= 0 && camera < 8 && shot < plan_.shots);
      }
    }
    (void)(*session)->Entries();
    (void)(*session)->Reference();
    (void)(*session)->DropDamaged();
    (void)(*session)->Finish(true, "", 1, 1, true);
  }

 private:
  std::filesystem::path root() const { return scratch_.path() / "damaged"; }
  static bool IsMark(const std::string& file) {
    return file == "sweeps/00001.released" || file == "sweeps/00002.released" ||
           file == "journal.sqlite-wal" || file == "journal.sqlite-shm";
  }

  fuzz::ScratchFolder scratch_;
  const Rig rig_ = SmallRig();
  const CompiledPlan plan_ = SweepingPlan(rig_);
  std::string id_;
  std::map<std::string, std::string> whole_;
};

}  // namespace
}  // namespace mesorig::daemon

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static daemon::Victim victim;
  victim.Restore();
  std::string_view text = fuzz::View(data, size);
  while (!text.empty()) victim.Do(fuzz::TakeUntil(text, "\n"));
  victim.Open();
  return 0;
}
