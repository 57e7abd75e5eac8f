#include "client/cli/session_export.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

namespace mesorig::client {
namespace {

Status WriteWhole(const std::filesystem::path& path, std::string_view bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out)
    return Unavailable("{}: writing {} bytes: {}", path.string(), bytes.size(), strerror(errno));
  return OkStatus();
}

std::string Numbers(const google::protobuf::RepeatedField<double>& values) {
  std::string text;
  for (const double value : values) text += fmt::format("{}{}", text.empty() ? "" : " ", value);
  return text;
}

}  // namespace

StatusOr<std::string> PgmOf(const v1::Frame& frame) {
  const v1::FrameHeader& h = frame.header();
  const size_t bytes = h.bits() > 8 ? 2 : 1;
  const uint64_t pixels = uint64_t{h.width()} * h.height();
  if (h.bits() < 1 || h.bits() > 16 || frame.pixels().size() != pixels * bytes) {
    return InvalidArgument("frame {} of camera {}: {} bytes for {} x {} pixels of {} bits",
                           h.sequence(), h.camera(), frame.pixels().size(), h.width(), h.height(),
                           h.bits());
  }
  std::string pgm = fmt::format("P5\n{} {}\n{}\n", h.width(), h.height(), (1u << h.bits()) - 1);
  const size_t start = pgm.size();
  pgm += frame.pixels();
  if (bytes == 2) {
    for (size_t i = start; i + 1 < pgm.size(); i += 2) std::swap(pgm[i], pgm[i + 1]);
  }
  return pgm;
}

std::string LedgerHeading() {
  return "camera\tshot\tsequence\tsupersedes\tframe_id\texposure_start_ns\texposure_end_ns\t"
         "exposure_s\twidth\theight\tbits\tregion_x\tregion_y\tsweep\tsweep_index\tdigest\t"
         "axis_rad\tlamp_level\tfile\n";
}

std::string LedgerLine(const v1::FrameHeader& h, std::string_view camera, std::string_view file) {
  return fmt::format("{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\t{}\n",
                     camera, h.shot(), h.sequence(), h.supersedes(), h.frame_id(),
                     h.exposure_start_ns(), h.exposure_end_ns(), h.exposure_s(), h.width(),
                     h.height(), h.bits(), h.region_x(), h.region_y(),
                     h.has_laser() ? std::to_string(h.laser().sweep()) : "",
                     h.has_laser() ? std::to_string(h.laser().index()) : "", h.digest(),
                     Numbers(h.axis_rad()), Numbers(h.lamp_level()), file);
}

StatusOr<SessionExport> SessionExport::Begin(const std::filesystem::path& out) {
  std::error_code error;
  if (std::filesystem::exists(out, error)) {
    return InvalidArgument("{}: is there already", out.string());
  }
  std::filesystem::path part = out;
  part += fmt::format(".{}.part", ::getpid());
  if (!std::filesystem::create_directory(part, error)) {
    return Unavailable("{}: cannot be created: {}", part.string(), error.message());
  }
  return SessionExport(out, std::move(part));
}

SessionExport::SessionExport(SessionExport&& other) noexcept
    : out_(std::move(other.out_)),
      part_(std::exchange(other.part_, {})),
      ledger_(std::move(other.ledger_)) {}

SessionExport::~SessionExport() {
  std::error_code ignored;
  if (!part_.empty()) std::filesystem::remove_all(part_, ignored);
}

Status SessionExport::Add(const v1::Frame& frame, std::string_view camera) {
  MESORIG_ASSIGN_OR_RETURN(const std::string pgm, PgmOf(frame));
  const auto folder = part_ / camera;
  std::error_code error;
  std::filesystem::create_directory(folder, error);
  if (error) return Unavailable("{}: cannot be created: {}", folder.string(), error.message());
  const std::string name = fmt::format("{}/shot{:06}.pgm", camera, frame.header().shot());
  ledger_ += LedgerLine(frame.header(), camera, name);
  return WriteWhole(part_ / name, pgm);
}

Status SessionExport::Commit() {
  MESORIG_RETURN_IF_ERROR(WriteWhole(part_ / "ledger.tsv", ledger_));
  std::error_code error;
  std::filesystem::rename(part_, out_, error);
  if (error) return Unavailable("{}: rename: {}", out_.string(), error.message());
  part_.clear();
  return OkStatus();
}

}  // namespace mesorig::client
