#include "processing/btf/file_kind.h"

#include "processing/btf/exr_attributes.h"
#include "processing/btf/exr_file.h"

namespace mesorig::btf {

StatusOr<FileKind> ReadFileKind(const std::filesystem::path& path) {
  MESORIG_ASSIGN_OR_RETURN(const ExrReader reader, ExrReader::Open(path));
  const std::string format = FormatOf(reader.header(0));
  if (format == kBtfFormat) return FileKind::kBtf;
  if (format == kMdfFormat) return FileKind::kMdf;
  return InvalidArgument("{}: an EXR file, but neither a BTF nor an MDF of mesorig", path.string());
}

}  // namespace mesorig::btf
