#pragma once
// The raw frames of a session as files that everything opens.

#include <filesystem>
#include <string>
#include <string_view>

#include "protocol/base/status.h"
#include "protocol/messages/frames.pb.h"

namespace mesorig::client {

// A PGM (P5), 8 or 16 bits (big-endian, as PGM has it), with the sensor's full scale as its
// maximum; a Bayer mosaic stays one. InvalidArgument for pixels that are not width x height.
StatusOr<std::string> PgmOf(const v1::Frame& frame);

// A column a field of the frame's ledger row, with tabs; and their names.
std::string LedgerHeading();
std::string LedgerLine(const v1::FrameHeader& header, std::string_view camera,
                       std::string_view file);

// Writes `out`/<camera>/shot<shot>.pgm and `out`/ledger.tsv: all of it, or nothing. `out` must not
// exist. A frame that was superseded gives way to the later one, its line stays.
class SessionExport {
 public:
  // InvalidArgument when `out` is there, Unavailable when it cannot be made.
  static StatusOr<SessionExport> Begin(const std::filesystem::path& out);
  SessionExport(SessionExport&& other) noexcept;
  SessionExport& operator=(SessionExport&&) = delete;
  ~SessionExport();  // without Commit, nothing stays
  Status Add(const v1::Frame& frame, std::string_view camera);
  Status Commit();

 private:
  SessionExport(std::filesystem::path out, std::filesystem::path part)
      : out_(std::move(out)), part_(std::move(part)), ledger_(LedgerHeading()) {}
  std::filesystem::path out_, part_;
  std::string ledger_;
};

}  // namespace mesorig::client
