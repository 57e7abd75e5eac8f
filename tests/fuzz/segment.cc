// A segment file: eight bytes offset, eight bytes of pixels, eight sequence, 32 characters digest
// of a ledger row, then the file. What is handed out has the row's digest.

#include "daemon/session/segment.h"

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const fuzz::ScratchFolder scratch;
  const auto path = scratch.path() / "cam0.seg";
  ByteReader reader(fuzz::View(data, size));
  daemon::FrameRecord row;
  row.offset = reader.Get<uint64_t>();
  row.bytes = reader.Get<uint64_t>();
  row.sequence = reader.Get<uint64_t>();
  row.digest = reader.GetRaw(32);
  if (!reader.ok()) return 0;
  const std::string_view file = reader.GetRaw(reader.remaining());
  (void)daemon::CheckSegmentHeader(file);
  (void)daemon::CheckRecordHeader(file, row);
  fuzz::Overwrite(path, file);
  const auto segment = daemon::SegmentReader::Open(path);
  if (!segment.ok()) return 0;
  const auto pixels = segment->Read(row);
  if (pixels.ok()) {
    MESORIG_CHECK((*pixels)->size() == row.bytes && FrameDigest(**pixels) == row.digest);
  } else {
    MESORIG_CHECK(absl::IsDataLoss(pixels.status()));
  }
  // A writer goes on wherever it is told to within the file.
  auto writer = daemon::SegmentWriter::Open(path, 0, "cam0", row.offset % (file.size() + 1));
  if (!writer.ok()) return 0;
  const std::string frame(64, 'x');
  row.sequence = 7, row.bytes = frame.size(), row.digest = FrameDigest(frame);
  const auto offset = writer->Append(row.sequence, 0, row.digest, frame);
  MESORIG_CHECK(offset.ok());
  row.offset = *offset;
  MESORIG_CHECK(segment->Read(row).ok());
  return 0;
}
