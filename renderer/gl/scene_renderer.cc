#include "renderer/gl/scene_renderer.h"

#include <algorithm>
#include <optional>

#include "renderer/gl/btf_texture.h"
#include "renderer/gl/gl_mesh.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/render_targets.h"
#include "renderer/gl/shaders.h"
#include "renderer/scene/view_transform.h"

namespace mesorig::renderer {
namespace {

constexpr char kVersionGlsl[] = "#version 450 core\n";
constexpr char kProbeGlsl[] = "#define MESORIG_PROBE\n";
constexpr int kProbeTargets = 5;
constexpr GLuint kHitUnit = 7;  // shaders/mdf_hit.glsl

// Places of the uniforms in shaders/mesh.vert and shaders/surface.glsl.
enum Location : GLint {
  kClipFromWorld = 0,
  kWorldFromObject = 1,
  kUnitsPerMm = 2,
  kEye = 3,
  kExposure = 4,
  kLightCount = 5,
  kLightDirection = 6,
  kIrradiance = 10,
  kObjectNumber = 14,
  kFinestLevel = 15,
  kPlainScale = 16,  // plain.frag; btf.frag has its own from here on
};

StatusOr<GlProgram> BuildFullscreen(std::string_view name, const char* fragment) {
  return BuildProgram(name, {{GL_VERTEX_SHADER, {kVersionGlsl, kFullscreenVertexGlsl}},
                             {GL_FRAGMENT_SHADER, {kVersionGlsl, fragment}}});
}

}  // namespace

struct SceneRenderer::State {
  // A program a material; those that the scene does not use have the name 0.
  struct Programs {
    std::array<GlProgram, 3> of_material;
    GLuint name(Material material) const {
      return of_material[static_cast<size_t>(material)].name();
    }
  };

  Scene scene;
  std::vector<GlMesh> meshes;  // as Scene::objects
  std::optional<BtfTexture> btf;
  std::optional<LayeredTexture> plain;
  std::optional<Silhouettes> silhouettes;
  Programs programs;
  GlProgram background_program, tone_map_program;
  GlVertexArray no_vertices;
  std::optional<LinearTarget> linear;
  std::optional<PictureTarget> picture;
  std::optional<SilhouetteTarget> silhouette_target;
  SilhouettePasses passes;

  StatusOr<GlProgram> BuildMaterial(Material material, bool probe) const;
  StatusOr<Programs> BuildMaterials(bool probe) const;
  void SetScene(GLuint program, bool probe) const;
  void BindTextures(Material material, GLuint program) const;
  // Into `target`, which is bound. `peeled` is of the same size; null where no object has an MDF.
  template <typename Target>
  SilhouettePasses DrawObjects(const Programs& programs, const Target& target,
                               const SilhouetteTarget* peeled) const;
  void DrawObject(size_t object, const Programs& programs) const;
  void DrawBackground() const;
  Status LoadMaterials(const BtfSource& source, const GlLimits& limits);
  Status LoadMdf(const BtfSource& source, const btf::Mdf* mdf, const GlLimits& limits);
  Status LoadMeshes(const BtfSource& source);
  Status MakeTargets(const GlLimits& limits);
};

StatusOr<GlProgram> SceneRenderer::State::BuildMaterial(Material material, bool probe) const {
  const std::string defines = std::string(probe ? kProbeGlsl : "") +
                              (material == Material::kBtfMdf ? "#define MESORIG_MDF\n" : "");
  std::vector<std::string> fragment = {kVersionGlsl, defines, kSurfaceGlsl};
  if (material == Material::kPlain) {
    fragment.push_back(kPlainFragmentGlsl);
  } else {
    fragment.insert(fragment.end(), btf->glsl().begin(), btf->glsl().end());
    if (material == Material::kBtfMdf) fragment.push_back(kMdfHitGlsl);
    fragment.push_back(kBtfFragmentGlsl);
  }
  return BuildProgram(material == Material::kPlain ? "plain" : "btf",
                      {{GL_VERTEX_SHADER, {kVersionGlsl, defines, kMeshVertexGlsl}},
                       {GL_FRAGMENT_SHADER, fragment}});
}

auto SceneRenderer::State::BuildMaterials(bool probe) const -> StatusOr<Programs> {
  Programs result;
  for (const Material material : {Material::kBtf, Material::kBtfMdf, Material::kPlain}) {
    if (!scene.Uses(material)) continue;
    MESORIG_ASSIGN_OR_RETURN(GlProgram program, BuildMaterial(material, probe));
    SetScene(program.name(), probe);
    result.of_material[static_cast<size_t>(material)] = std::move(program);
  }
  return result;
}

void SceneRenderer::State::SetScene(GLuint program, bool probe) const {
  const ImageSettings& image = scene.image;
  SetMatrix(program, kClipFromWorld,
            Product(Projection(scene.camera, static_cast<double>(image.width) / image.height),
                    CameraFromWorld(scene.camera)));
  SetVector(program, kEye, scene.camera.eye_mm);
  glProgramUniform1f(program, kExposure, static_cast<float>(image.exposure));
  glProgramUniform1f(program, kFinestLevel, probe ? -1000.0f : 0.0f);
  glProgramUniform1i(program, kLightCount, static_cast<GLint>(scene.lights.size()));
  for (size_t i = 0; i < scene.lights.size(); ++i) {
    SetVector(program, kLightDirection + static_cast<GLint>(i), scene.lights[i].direction);
    SetVector(program, kIrradiance + static_cast<GLint>(i), scene.lights[i].irradiance);
  }
}

void SceneRenderer::State::BindTextures(Material material, GLuint program) const {
  if (material == Material::kPlain) {
    glBindTextureUnit(1, plain->texture.name());
    glProgramUniform1f(program, kPlainScale, plain->scale);
  } else {
    btf->Bind(program);
  }
}

void SceneRenderer::State::DrawObject(size_t object, const Programs& with) const {
  const GlMesh& mesh = meshes[object];
  const GLuint program = with.name(mesh.material);
  BindTextures(mesh.material, program);
  SetMatrix(program, kWorldFromObject, mesh.world_from_object);
  glProgramUniform2f(program, kUnitsPerMm, static_cast<float>(mesh.units_per_mm.x),
                     static_cast<float>(mesh.units_per_mm.y));
  glProgramUniform1f(program, kObjectNumber, static_cast<float>(object + 1));
  glUseProgram(program);
  mesh.Draw();
}

template <typename Target>
SilhouettePasses SceneRenderer::State::DrawObjects(const Programs& with, const Target& target,
                                                   const SilhouetteTarget* peeled) const {
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_CULL_FACE);
  SilhouettePasses result;
  for (size_t i = 0; i < meshes.size(); ++i) {
    if (meshes[i].material == Material::kBtfMdf) {
      const SilhouettePasses found = silhouettes->Find(meshes[i], *peeled);
      result.passes = std::max(result.passes, found.passes);
      result.exhausted = result.exhausted || found.exhausted;
      target.Resume();
      glBindTextureUnit(kHitUnit, peeled->hit());
    }
    DrawObject(i, with);
  }
  return result;
}

void SceneRenderer::State::DrawBackground() const {
  glDisable(GL_DEPTH_TEST);
  glUseProgram(background_program.name());
  glBindVertexArray(no_vertices.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

Status SceneRenderer::State::LoadMaterials(const BtfSource& source, const GlLimits& limits) {
  if (scene.Uses(Material::kBtf) || scene.Uses(Material::kBtfMdf)) {
    MESORIG_ASSIGN_OR_RETURN(btf, BtfTexture::Create(source, limits));
  }
  if (scene.Uses(Material::kPlain)) {
    MESORIG_ASSIGN_OR_RETURN(const std::vector<float> texture, source.PlainTexture());
    MESORIG_ASSIGN_OR_RETURN(plain, MakeLayeredTexture(GL_TEXTURE_2D, source.header().width,
                                                       source.header().height, 1, texture, limits));
  }
  MESORIG_ASSIGN_OR_RETURN(programs, BuildMaterials(false));
  return OkStatus();
}

Status SceneRenderer::State::LoadMdf(const BtfSource& source, const btf::Mdf* mdf,
                                     const GlLimits& limits) {
  if (!scene.Uses(Material::kBtfMdf)) return OkStatus();
  const ImageSettings& image = scene.image;
  if (mdf == nullptr) {
    return InvalidArgument("an object is of the material \"btf+mdf\", but there is no MDF");
  }
  if (image.msaa > 1) {
    return InvalidArgument(
        "msaa = {} with an object of the material \"btf+mdf\"; permitted is 1 (supersample "
        "antialiases the relief's silhouettes too)",
        image.msaa);
  }
  const btf::BtfHeader& header = source.header();
  MESORIG_RETURN_IF_ERROR(CheckSameSample(header.width, header.height, header.pitch_mm,
                                          header.h_ref_mm, mdf->header()));
  MESORIG_ASSIGN_OR_RETURN(silhouettes, Silhouettes::Create(*mdf, scene, limits));
  MESORIG_ASSIGN_OR_RETURN(
      silhouette_target,
      SilhouetteTarget::Create(image.width * image.supersample, image.height * image.supersample));
  return OkStatus();
}

Status SceneRenderer::State::LoadMeshes(const BtfSource& source) {
  const btf::BtfHeader& header = source.header();
  for (const Object& object : scene.objects) {
    MESORIG_ASSIGN_OR_RETURN(const TextureScale scale,
                             ScaleTexture(object, header.width * header.pitch_mm,
                                          static_cast<double>(header.height) / header.width));
    meshes.push_back(UploadObject(object, scale));
  }
  return CheckGl("the scene's meshes");
}

Status SceneRenderer::State::MakeTargets(const GlLimits& limits) {
  const ImageSettings& image = scene.image;
  const int width = image.width * image.supersample, height = image.height * image.supersample;
  if (image.msaa > limits.samples) {
    return InvalidArgument("msaa = {}; permitted by this OpenGL is at most {}", image.msaa,
                           limits.samples);
  }
  if (std::max(width, height) > limits.texture_size) {
    return InvalidArgument(
        "the picture of {} x {} pixels at supersample {} needs a target of "
        "{} x {}; permitted by this OpenGL is at most {} a side",
        image.width, image.height, image.supersample, width, height, limits.texture_size);
  }
  MESORIG_ASSIGN_OR_RETURN(linear, LinearTarget::Create(width, height, image.msaa));
  MESORIG_ASSIGN_OR_RETURN(picture, PictureTarget::Create(image.width, image.height));
  MESORIG_ASSIGN_OR_RETURN(background_program,
                           BuildFullscreen("background", kBackgroundFragmentGlsl));
  MESORIG_ASSIGN_OR_RETURN(tone_map_program, BuildFullscreen("tone_map", kToneMapFragmentGlsl));
  SetVector(background_program.name(), 0, image.background_top);
  SetVector(background_program.name(), 1, image.background_bottom);
  glProgramUniform1i(tone_map_program.name(), 0, image.supersample);
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  no_vertices = GlVertexArray(name);
  return CheckGl("the picture's targets");
}

SceneRenderer::SceneRenderer(std::unique_ptr<State> state) : state_(std::move(state)) {}
SceneRenderer::SceneRenderer(SceneRenderer&& other) noexcept = default;
SceneRenderer::~SceneRenderer() = default;

StatusOr<SceneRenderer> SceneRenderer::Create(const Scene& scene, const BtfSource& source,
                                              const GlContext& context, const btf::Mdf* mdf) {
  auto state = std::make_unique<State>();
  state->scene = scene;
  MESORIG_RETURN_IF_ERROR(state->MakeTargets(context.limits()));
  MESORIG_RETURN_IF_ERROR(state->LoadMeshes(source));
  MESORIG_RETURN_IF_ERROR(state->LoadMdf(source, mdf, context.limits()));
  MESORIG_RETURN_IF_ERROR(state->LoadMaterials(source, context.limits()));
  return SceneRenderer(std::move(state));
}

void SceneRenderer::Draw() {
  state_->linear->Bind();
  state_->DrawBackground();
  const SilhouetteTarget* peeled =
      state_->silhouette_target ? &*state_->silhouette_target : nullptr;
  state_->passes = state_->DrawObjects(state_->programs, *state_->linear, peeled);
  const GLuint resolved = state_->linear->Resolve();
  state_->picture->Bind();
  glDisable(GL_DEPTH_TEST);
  glBindTextureUnit(0, resolved);
  glUseProgram(state_->tone_map_program.name());
  glBindVertexArray(state_->no_vertices.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glFinish();
}

SilhouettePasses SceneRenderer::silhouette_passes() const { return state_->passes; }

StatusOr<Picture> SceneRenderer::ReadPicture() const {
  Picture picture = state_->picture->Read();
  MESORIG_RETURN_IF_ERROR(CheckGl("drawing the scene"));
  return picture;
}

StatusOr<std::vector<Fragment>> SceneRenderer::Probe() const {
  const int width = state_->scene.image.width, height = state_->scene.image.height;
  MESORIG_ASSIGN_OR_RETURN(const ProbeTarget target,
                           ProbeTarget::Create(width, height, kProbeTargets));
  MESORIG_ASSIGN_OR_RETURN(const State::Programs programs, state_->BuildMaterials(true));
  std::optional<SilhouetteTarget> peeled;
  if (state_->silhouettes) {
    MESORIG_ASSIGN_OR_RETURN(peeled, SilhouetteTarget::Create(width, height));
  }
  target.Bind();
  state_->DrawObjects(programs, target, peeled ? &*peeled : nullptr);
  std::array<std::vector<float>, kProbeTargets> read;
  for (int i = 0; i < kProbeTargets; ++i) read[static_cast<size_t>(i)] = target.Read(i);
  MESORIG_RETURN_IF_ERROR(CheckGl("probing the scene"));
  const auto& [radiance, uv_object, view, normal, tangent] = read;
  const auto vector = [](const std::vector<float>& from, size_t at) {
    return Vec3{from[at], from[at + 1], from[at + 2]};
  };
  std::vector<Fragment> fragments;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const size_t at =
          (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) * 4;
      if (uv_object[at + 2] <= 0) continue;
      fragments.push_back({x,
                           y,
                           static_cast<int>(uv_object[at + 2]) - 1,
                           uv_object[at],
                           uv_object[at + 1],
                           vector(view, at),
                           vector(normal, at),
                           vector(tangent, at),
                           {radiance[at], radiance[at + 1], radiance[at + 2]}});
    }
  }
  return fragments;
}

}  // namespace mesorig::renderer
