// Importer of multi-light image stacks; README.md says what is read.

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "processing/exchange/importer.h"
#include "processing/exchange/multi_light/light_file.h"
#include "processing/image/image_file.h"
#include "protocol/base/file_writer.h"

namespace mesorig::exchange::multi_light {
namespace {

namespace fs = std::filesystem;

constexpr uint8_t kMaskThreshold = 128;
constexpr size_t kMaxFiles = 100000;

struct Stack {
  std::vector<fs::path> photographs;  // in natural order of their names
  std::optional<fs::path> mask, lp;
};

StatusOr<Stack> ListFolder(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return NotFound("{}: no such folder", folder.string());
  if (!fs::is_directory(folder, error)) return InvalidArgument("{}: is not a folder", folder.string());
  std::vector<fs::path> files;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    files.push_back(it->path());
    if (files.size() > kMaxFiles) {
      return InvalidArgument("{}: holds more than {} files", folder.string(), kMaxFiles);
    }
  }
  if (error) return InvalidArgument("{}: {}", folder.string(), error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return NaturalLess(a.filename().string(), b.filename().string());
  });
  Stack stack;
  for (const fs::path& file : files) {
    if (file.extension() == ".lp") {
      if (stack.lp) {
        return InvalidArgument("{}: two .lp files, {} and {}", folder.string(),
                               stack.lp->filename().string(), file.filename().string());
      }
      stack.lp = file;
    } else if (image::IsImageName(file)) {
      const bool is_mask = file.stem().extension() == ".mask" || file.stem() == "mask";
      if (is_mask) {
        stack.mask = file;
      } else {
        stack.photographs.push_back(file);
      }
    }
  }
  return stack;
}

struct Photograph {
  fs::path path;
  Vec3 light;
};

StatusOr<std::vector<Photograph>> FromLp(const Stack& stack, const fs::path& folder) {
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(*stack.lp));
  MESORIG_ASSIGN_OR_RETURN(const auto entries, ParseLp(text, stack.lp->string()));
  std::vector<Photograph> photographs;
  for (const LightEntry& entry : entries) {
    // Only the name: such files carry the folders of the machine that wrote them.
    const size_t slash = entry.image.find_last_of("/\\");
    const std::string name =
        slash == std::string::npos ? entry.image : entry.image.substr(slash + 1);
    photographs.push_back({folder / name, entry.direction});
  }
  return photographs;
}

StatusOr<std::vector<Photograph>> FromLightsTxt(const Stack& stack, const fs::path& folder) {
  std::error_code error;
  fs::path file = folder / "lights.txt";
  if (!fs::exists(file, error)) {
    const fs::path absolute = fs::absolute(folder, error).lexically_normal();
    const fs::path here = absolute.has_filename() ? absolute : absolute.parent_path();
    file = here.parent_path() / "lights.txt";
  }
  if (!fs::exists(file, error)) {
    return NotFound("{}: neither a .lp file nor lights.txt in it, nor lights.txt in its parent",
                    folder.string());
  }
  MESORIG_ASSIGN_OR_RETURN(const std::string text, ReadFile(file));
  MESORIG_ASSIGN_OR_RETURN(const auto entries, ParseLights(text, file.string()));
  if (entries.size() != stack.photographs.size()) {
    return InvalidArgument("{}: {} photographs, {} lights in {}", folder.string(),
                           stack.photographs.size(), entries.size(), file.string());
  }
  std::vector<Photograph> photographs;
  for (size_t i = 0; i < entries.size(); ++i) {
    photographs.push_back({stack.photographs[i], entries[i].direction});
  }
  return photographs;
}

StatusOr<image::Image8> ReadOfSize(const fs::path& path, const btf::BtfHeader& header) {
  MESORIG_ASSIGN_OR_RETURN(image::Image8 image, image::ReadImage(path));
  if (image.width != header.width || image.height != header.height) {
    return InvalidArgument("{}: {} x {} pixels, the first photograph has {} x {}", path.string(),
                           image.width, image.height, header.width, header.height);
  }
  return image;
}

btf::BtfHeader HeaderOf(const image::Image8& first, const std::vector<Photograph>& photographs,
                        const fs::path& folder) {
  btf::BtfHeader header;
  header.width = first.width;
  header.height = first.height;
  header.views = {{0, 0, 1}};
  for (const Photograph& photograph : photographs) header.lights.push_back(photograph.light);
  header.cosine_included = true;  // photographs of a lit sample
  header.calibrated = false;
  header.primaries = "rec709";
  nlohmann::json provenance = {{"import", "multi-light"},
                               {"folder", folder.filename().string()}};
  for (const Photograph& p : photographs) {
    provenance["photographs"].push_back(p.path.filename().string());
  }
  // Names need not be UTF-8.
  header.provenance_json =
      provenance.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  return header;
}

class MultiLight final : public Importer {
 public:
  std::string_view name() const override { return "multi-light"; }
  std::string_view description() const override {
    return "a folder of photographs with lights.txt or a .lp file: one view, many lights";
  }

  StatusOr<btf::SampledBtf> Import(const fs::path& folder) const override {
    MESORIG_ASSIGN_OR_RETURN(const Stack stack, ListFolder(folder));
    MESORIG_ASSIGN_OR_RETURN(const std::vector<Photograph> photographs,
                             stack.lp ? FromLp(stack, folder) : FromLightsTxt(stack, folder));
    MESORIG_ASSIGN_OR_RETURN(image::Image8 image, image::ReadImage(photographs[0].path));
    btf::BtfHeader header = HeaderOf(image, photographs, folder);
    const Status valid = CheckHeader(header);
    if (!valid.ok()) return Annotate(valid, folder.string());
    if (stack.mask) {
      MESORIG_ASSIGN_OR_RETURN(const image::Image8 mask, ReadOfSize(*stack.mask, header));
      for (size_t i = 0; i < header.texel_count(); ++i) {
        header.mask.push_back(mask.rgb[3 * i] > kMaskThreshold ? 1 : 0);
      }
    }
    btf::SampledBtf btf(header);
    for (size_t l = 0; l < photographs.size(); ++l) {
      MESORIG_ASSIGN_OR_RETURN(image, ReadOfSize(photographs[l].path, header));
      const int light = static_cast<int>(l);
      std::transform(image.rgb.begin(), image.rgb.end(), btf.MutableImage(0, light).begin(),
                     [](uint8_t code) { return static_cast<float>(code) / 255.0f; });
      btf.SetPresent(0, light, true);
    }
    return btf;
  }
};

}  // namespace

const Importer& TheImporter() {
  static const MultiLight importer;
  return importer;
}

}  // namespace mesorig::exchange::multi_light
