#include "processing/service/product_folder.h"

#include <charconv>

#include "protocol/base/file_writer.h"

namespace mesorig::service {

Status CheckSessionId(const std::string& session_id) {
  if (session_id.empty() || session_id.size() > 200 || session_id[0] == '.' ||
      session_id.find_first_of(std::string_view("/\0", 2)) != std::string::npos) {
    return InvalidArgument("\"{}\" is no session id", session_id);
  }
  return OkStatus();
}

v1::Product ProductOf(const char* kind, const std::filesystem::path& path, uint64_t bytes) {
  v1::Product product;
  product.set_kind(kind);
  product.set_path(std::filesystem::absolute(path).string());
  product.set_bytes(bytes);
  return product;
}

std::filesystem::path BtfPath(const std::filesystem::path& folder) {
  return folder / "sample.btf.exr";
}
std::filesystem::path MdfPath(const std::filesystem::path& folder) {
  return folder / "sample.mdf.exr";
}

std::filesystem::path DisplacementsPath(const std::filesystem::path& folder) {
  return folder / "displacements";
}

std::vector<v1::Product> ProductsOnDisk(const std::filesystem::path& folder) {
  std::vector<v1::Product> products;
  std::error_code error;
  const auto btf_bytes = std::filesystem::file_size(BtfPath(folder), error);
  if (!error) products.push_back(ProductOf("btf", BtfPath(folder), btf_bytes));
  const auto mdf_bytes = std::filesystem::file_size(MdfPath(folder), error);
  if (!error) {
    products.push_back(ProductOf("mdf", MdfPath(folder), mdf_bytes));
  } else if (std::filesystem::exists(DisplacementsPath(folder), error)) {
    products.clear();
  }
  return products;
}

namespace {
std::filesystem::path StartPath(const std::filesystem::path& folder) { return folder / "start"; }
}  // namespace

uint32_t StartOfProducts(const std::filesystem::path& folder) {
  const auto text = ReadFile(StartPath(folder), 32);
  uint32_t start = 0;
  if (text.ok()) (void)std::from_chars(text->data(), text->data() + text->size(), start);
  return start;
}

Status BeginProducts(const std::filesystem::path& folder, uint32_t start) {
  if (StartOfProducts(folder) == start) return OkStatus();
  for (const std::filesystem::path& stale : {BtfPath(folder), MdfPath(folder)}) {
    std::error_code error;
    std::filesystem::remove(stale, error);
    if (error) return Unavailable("cannot remove {}: {}", stale.string(), error.message());
  }
  return WriteFileAtomically(StartPath(folder), fmt::format("{}\n", start));
}

}  // namespace mesorig::service
