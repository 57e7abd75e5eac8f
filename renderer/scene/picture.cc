#include "renderer/scene/picture.h"

#include "protocol/base/check.h"
#include "protocol/base/file_writer.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STB_IMAGE_WRITE_STATIC
#define STBI_WRITE_NO_STDIO
#include <stb_image_write.h>
#pragma GCC diagnostic pop

namespace mesorig::renderer {

Status WritePng(const Picture& picture, const std::filesystem::path& path) {
  MESORIG_CHECK(picture.rgb.size() ==
                static_cast<size_t>(picture.width) * static_cast<size_t>(picture.height) * 3);
  if (path.extension() != ".png") {
    return InvalidArgument("{}: pictures are written as PNG: the name must end in .png",
                           path.string());
  }
  std::string bytes;
  const auto append = [](void* context, void* data, int size) {
    static_cast<std::string*>(context)->append(static_cast<const char*>(data),
                                               static_cast<size_t>(size));
  };
  if (stbi_write_png_to_func(append, &bytes, picture.width, picture.height, 3, picture.rgb.data(),
                             picture.width * 3) == 0) {
    return Internal("{}: the PNG encoder failed", path.string());
  }
  return WriteFileAtomically(path, bytes);
}

}  // namespace mesorig::renderer
