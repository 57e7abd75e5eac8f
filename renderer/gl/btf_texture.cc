#include "renderer/gl/btf_texture.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "renderer/gl/shaders.h"

namespace mesorig::renderer {
namespace {

Status CheckLayers(const BtfSource& source, size_t layers, const GlLimits& limits) {
  const btf::BtfHeader& header = source.header();
  if (layers > static_cast<size_t>(limits.array_layers)) {
    return InvalidArgument(
        "the {} BTF of {} views x {} lights needs {} texture layers; permitted by this OpenGL is "
        "at most {}: compress it (mesorig-btf compress --codec view-svd, fewer --terms)",
        source.codec(), header.view_count(), header.light_count(), layers, limits.array_layers);
  }
  return OkStatus();
}

// Every measured image a layer: for an uncompressed BTF, and for a codec without a GLSL decoder.
StatusOr<codecs::ShaderForm> ImagesAsLayers(const BtfSource& source, const GlLimits& limits) {
  const btf::BtfHeader& header = source.header();
  codecs::ShaderForm form;
  const size_t pairs = header.views.size() * header.lights.size();
  MESORIG_RETURN_IF_ERROR(CheckLayers(source, pairs, limits));
  form.layers = static_cast<int>(pairs);
  form.columns = header.light_count();
  form.glsl = kDecodeRawGlsl;
  form.rgb.reserve(pairs * header.texel_count() * 3);
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      const bool present = source.Present(v, l);
      if (present) {
        const std::vector<float> image = source.Image(v, l);
        form.rgb.insert(form.rgb.end(), image.begin(), image.end());
      } else {
        form.rgb.resize(form.rgb.size() + header.texel_count() * 3);
      }
    }
  }
  return form;
}

StatusOr<codecs::ShaderForm> FormOf(const BtfSource& source, const GlLimits& limits) {
  std::optional<codecs::ShaderForm> form;
  if (source.encoded() != nullptr) form = source.encoded()->ToShader();
  if (!form) return ImagesAsLayers(source, limits);
  MESORIG_RETURN_IF_ERROR(CheckLayers(source, static_cast<size_t>(form->layers), limits));
  return *std::move(form);
}

// For every pair view * lights + light: -1 where it is present, else the nearest pair that is
// (btf::PairInterpolator, where everything around is absent). Empty where none is absent.
std::vector<float> Substitutes(const BtfSource& source) {
  const btf::BtfHeader& header = source.header();
  std::vector<float> substitutes;
  bool all = true;
  for (int v = 0; v < header.view_count(); ++v) {
    for (int l = 0; l < header.light_count(); ++l) {
      if (source.Present(v, l)) {
        substitutes.push_back(-1);
        continue;
      }
      all = false;
      const btf::PairWeights nearest = source.interpolator().Lookup(
          header.views[static_cast<size_t>(v)], header.lights[static_cast<size_t>(l)]);
      substitutes.push_back(
          static_cast<float>(nearest.view[0] * header.light_count() + nearest.light[0]));
    }
  }
  return all ? std::vector<float>() : substitutes;
}

std::vector<std::array<float, 4>> LightDirections(const BtfSource& source) {
  std::vector<std::array<float, 4>> rows;
  for (const Vec3 l : source.interpolator().lights().directions()) {
    rows.push_back({static_cast<float>(l.x), static_cast<float>(l.y), static_cast<float>(l.z), 0});
  }
  return rows;
}

}  // namespace

StatusOr<LayeredTexture> MakeLayeredTexture(GLenum target, int width, int height, int layers,
                                            const std::vector<float>& rgb, const GlLimits& limits) {
  if (std::max(width, height) > limits.texture_size) {
    return InvalidArgument(
        "the BTF has {} x {} texels; permitted by this OpenGL is at most {} a "
        "side",
        width, height, limits.texture_size);
  }
  float largest = 0;
  for (float value : rgb) largest = std::max(largest, std::abs(value));
  LayeredTexture result;
  // Half floats reach from 6e-8 to 65504: bring the largest magnitude to [128, 256).
  if (largest > 0) result.scale = std::exp2(std::floor(std::log2(largest)) - 7);
  std::vector<float> scaled(rgb.size());
  std::transform(rgb.begin(), rgb.end(), scaled.begin(),
                 [&](float value) { return value / result.scale; });
  GLuint name = 0;
  glCreateTextures(target, 1, &name);
  result.texture = GlTexture(name);
  const int levels = std::bit_width(static_cast<unsigned>(std::max(width, height)));
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  if (target == GL_TEXTURE_2D_ARRAY) {
    glTextureStorage3D(name, levels, GL_RGBA16F, width, height, layers);
    glTextureSubImage3D(name, 0, 0, 0, 0, width, height, layers, GL_RGB, GL_FLOAT, scaled.data());
  } else {
    glTextureStorage2D(name, levels, GL_RGBA16F, width, height);
    glTextureSubImage2D(name, 0, 0, 0, width, height, GL_RGB, GL_FLOAT, scaled.data());
  }
  glGenerateTextureMipmap(name);
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
  glTextureParameteri(name, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTextureParameteri(name, GL_TEXTURE_WRAP_S, GL_REPEAT);
  glTextureParameteri(name, GL_TEXTURE_WRAP_T, GL_REPEAT);
  MESORIG_RETURN_IF_ERROR(
      CheckGl(fmt::format("a texture of {} x {} x {} texels", width, height, layers)));
  return result;
}

StatusOr<BtfTexture> BtfTexture::Create(const BtfSource& source, const GlLimits& limits) {
  const btf::BtfHeader& header = source.header();
  MESORIG_ASSIGN_OR_RETURN(codecs::ShaderForm form, FormOf(source, limits));
  BtfTexture result;
  MESORIG_ASSIGN_OR_RETURN(result.layers_,
                           MakeLayeredTexture(GL_TEXTURE_2D_ARRAY, header.width, header.height,
                                              form.layers, form.rgb, limits));
  result.bytes_ = header.texel_count() * static_cast<size_t>(form.layers) * 8;
  result.columns_ = form.columns;
  const std::vector<float> substitutes = Substitutes(source);
  if (substitutes.empty()) {
    result.glsl_.push_back("#define MESORIG_ALL_PRESENT\n");
  } else {
    result.substitutes_ = MakeBufferTexture(GL_R32F, substitutes);
    result.light_directions_ = MakeBufferTexture(GL_RGBA32F, LightDirections(source));
  }
  result.glsl_.insert(result.glsl_.end(),
                      {kDirectionsGlsl, kPairsGlsl, kDecodeInputsGlsl, std::move(form.glsl)});
  DirectionTables tables;
  tables.Append(source.interpolator().views());
  tables.Append(source.interpolator().lights());
  result.table_ = MakeBufferTexture(GL_R32F, form.table);
  result.direction_rows_ = MakeBufferTexture(GL_RGBA32F, tables.rows);
  result.direction_map_ = MakeBufferTexture(GL_R32F, tables.map);
  MESORIG_RETURN_IF_ERROR(CheckGl("the BTF's tables"));
  return result;
}

void BtfTexture::Bind(GLuint program) const {
  glBindTextureUnit(0, layers_.texture.name());
  glBindTextureUnit(2, direction_rows_.texture.name());
  glBindTextureUnit(3, direction_map_.texture.name());
  glBindTextureUnit(4, table_.texture.name());
  glBindTextureUnit(5, light_directions_.texture.name());
  glBindTextureUnit(6, substitutes_.texture.name());
  glProgramUniform1i(program, 16, DirectionTables::kMapSize * DirectionTables::kMapSize);
  glProgramUniform1i(program, 17, columns_);
  glProgramUniform1f(program, 18, layers_.scale);
}

}  // namespace mesorig::renderer
