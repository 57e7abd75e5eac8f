#include "renderer/gl/scene_renderer.h"

#include <algorithm>
#include <cstddef>
#include <optional>

#include "renderer/gl/btf_texture.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/render_targets.h"
#include "renderer/gl/shaders.h"
#include "renderer/scene/mesh.h"
#include "renderer/scene/view_transform.h"

namespace mesorig::renderer {
namespace {

constexpr char kVersionGlsl[] = "#version 450 core\n";
constexpr char kProbeGlsl[] = "#define MESORIG_PROBE\n";
constexpr int kProbeTargets = 5;

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

struct GlMesh {
  GlVertexArray array;
  GlBuffer vertices, indices;
  GLsizei index_count = 0;
  Matrix4 world_from_object;
  TextureScale units_per_mm;
  Material material = Material::kBtf;
};

GlMesh Upload(const Mesh& mesh) {
  GlMesh result;
  result.vertices = MakeBuffer(mesh.vertices);
  result.indices = MakeBuffer(mesh.indices);
  result.index_count = static_cast<GLsizei>(mesh.indices.size());
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  result.array = GlVertexArray(name);
  glVertexArrayVertexBuffer(name, 0, result.vertices.name(), 0, sizeof(Vertex));
  glVertexArrayElementBuffer(name, result.indices.name());
  const struct {
    GLint size;
    size_t offset;
  } attributes[] = {{3, offsetof(Vertex, position)},
                    {3, offsetof(Vertex, normal)},
                    {3, offsetof(Vertex, tangent)},
                    {2, offsetof(Vertex, texture_mm)}};
  GLuint index = 0;
  for (const auto& attribute : attributes) {
    glEnableVertexArrayAttrib(name, index);
    glVertexArrayAttribFormat(name, index, attribute.size, GL_FLOAT, GL_FALSE,
                              static_cast<GLuint>(attribute.offset));
    glVertexArrayAttribBinding(name, index, 0);
    ++index;
  }
  return result;
}

void SetVector(GLuint program, GLint location, Vec3 value) {
  glProgramUniform3f(program, location, static_cast<float>(value.x), static_cast<float>(value.y),
                     static_cast<float>(value.z));
}

void SetMatrix(GLuint program, GLint location, const Matrix4& value) {
  std::array<float, 16> floats;
  for (size_t i = 0; i < 16; ++i) floats[i] = static_cast<float>(value[i]);
  glProgramUniformMatrix4fv(program, location, 1, GL_FALSE, floats.data());
}

StatusOr<GlProgram> BuildFullscreen(std::string_view name, const char* fragment) {
  return BuildProgram(name, {{GL_VERTEX_SHADER, {kVersionGlsl, kFullscreenVertexGlsl}},
                             {GL_FRAGMENT_SHADER, {kVersionGlsl, fragment}}});
}

}  // namespace

struct SceneRenderer::State {
  Scene scene;
  std::vector<GlMesh> meshes;  // as Scene::objects
  std::optional<BtfTexture> btf;
  std::optional<LayeredTexture> plain;
  GlProgram btf_program, plain_program, background_program, tone_map_program;
  GlVertexArray no_vertices;
  std::optional<LinearTarget> linear;
  std::optional<PictureTarget> picture;

  StatusOr<GlProgram> BuildMaterial(Material material, bool probe) const;
  void SetScene(GLuint program, bool probe) const;
  void BindTextures(GLuint btf_name, GLuint plain_name) const;
  void DrawObjects(GLuint btf, GLuint plain) const;
  void DrawBackground() const;
  Status LoadMaterials(const BtfSource& source, const GlLimits& limits);
  Status LoadMeshes(const BtfSource& source);
  Status MakeTargets(const GlLimits& limits);
};

StatusOr<GlProgram> SceneRenderer::State::BuildMaterial(Material material, bool probe) const {
  const char* probe_glsl = probe ? kProbeGlsl : "";
  std::vector<std::string> fragment = {kVersionGlsl, probe_glsl, kSurfaceGlsl};
  if (material == Material::kBtf) {
    fragment.insert(fragment.end(), btf->glsl().begin(), btf->glsl().end());
    fragment.push_back(kBtfFragmentGlsl);
  } else {
    fragment.push_back(kPlainFragmentGlsl);
  }
  return BuildProgram(
      material == Material::kBtf ? "btf" : "plain",
      {{GL_VERTEX_SHADER, {kVersionGlsl, kMeshVertexGlsl}}, {GL_FRAGMENT_SHADER, fragment}});
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

void SceneRenderer::State::BindTextures(GLuint btf_name, GLuint plain_name) const {
  if (btf) btf->Bind(btf_name);
  if (plain) {
    glBindTextureUnit(1, plain->texture.name());
    glProgramUniform1f(plain_name, kPlainScale, plain->scale);
  }
}

void SceneRenderer::State::DrawObjects(GLuint btf_name, GLuint plain_name) const {
  BindTextures(btf_name, plain_name);
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_CULL_FACE);
  for (size_t i = 0; i < meshes.size(); ++i) {
    const GlMesh& mesh = meshes[i];
    const GLuint program = mesh.material == Material::kBtf ? btf_name : plain_name;
    SetMatrix(program, kWorldFromObject, mesh.world_from_object);
    glProgramUniform2f(program, kUnitsPerMm, static_cast<float>(mesh.units_per_mm.x),
                       static_cast<float>(mesh.units_per_mm.y));
    glProgramUniform1f(program, kObjectNumber, static_cast<float>(i + 1));
    glUseProgram(program);
    glBindVertexArray(mesh.array.name());
    glDrawElements(GL_TRIANGLES, mesh.index_count, GL_UNSIGNED_INT, nullptr);
  }
}

void SceneRenderer::State::DrawBackground() const {
  glDisable(GL_DEPTH_TEST);
  glUseProgram(background_program.name());
  glBindVertexArray(no_vertices.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

Status SceneRenderer::State::LoadMaterials(const BtfSource& source, const GlLimits& limits) {
  if (scene.Uses(Material::kBtf)) {
    MESORIG_ASSIGN_OR_RETURN(btf, BtfTexture::Create(source, limits));
    MESORIG_ASSIGN_OR_RETURN(btf_program, BuildMaterial(Material::kBtf, false));
    SetScene(btf_program.name(), false);
  }
  if (scene.Uses(Material::kPlain)) {
    MESORIG_ASSIGN_OR_RETURN(const std::vector<float> texture, source.PlainTexture());
    MESORIG_ASSIGN_OR_RETURN(plain, MakeLayeredTexture(GL_TEXTURE_2D, source.header().width,
                                                       source.header().height, 1, texture, limits));
    MESORIG_ASSIGN_OR_RETURN(plain_program, BuildMaterial(Material::kPlain, false));
    SetScene(plain_program.name(), false);
  }
  return OkStatus();
}

Status SceneRenderer::State::LoadMeshes(const BtfSource& source) {
  const btf::BtfHeader& header = source.header();
  for (const Object& object : scene.objects) {
    MESORIG_ASSIGN_OR_RETURN(const TextureScale scale,
                             ScaleTexture(object, header.width * header.pitch_mm,
                                          static_cast<double>(header.height) / header.width));
    GlMesh mesh = Upload(MakeMesh(object));
    mesh.world_from_object = FromRigid(Placement(object));
    mesh.units_per_mm = scale;
    mesh.material = object.material;
    meshes.push_back(std::move(mesh));
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
                                              const GlContext& context) {
  auto state = std::make_unique<State>();
  state->scene = scene;
  MESORIG_RETURN_IF_ERROR(state->MakeTargets(context.limits()));
  MESORIG_RETURN_IF_ERROR(state->LoadMeshes(source));
  MESORIG_RETURN_IF_ERROR(state->LoadMaterials(source, context.limits()));
  return SceneRenderer(std::move(state));
}

void SceneRenderer::Draw() {
  state_->linear->Bind();
  state_->DrawBackground();
  state_->DrawObjects(state_->btf_program.name(), state_->plain_program.name());
  const GLuint resolved = state_->linear->Resolve();
  state_->picture->Bind();
  glDisable(GL_DEPTH_TEST);
  glBindTextureUnit(0, resolved);
  glUseProgram(state_->tone_map_program.name());
  glBindVertexArray(state_->no_vertices.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  glFinish();
}

StatusOr<Picture> SceneRenderer::ReadPicture() const {
  Picture picture = state_->picture->Read();
  MESORIG_RETURN_IF_ERROR(CheckGl("drawing the scene"));
  return picture;
}

StatusOr<std::vector<Fragment>> SceneRenderer::Probe() const {
  const int width = state_->scene.image.width, height = state_->scene.image.height;
  MESORIG_ASSIGN_OR_RETURN(const ProbeTarget target,
                           ProbeTarget::Create(width, height, kProbeTargets));
  GlProgram btf_program, plain_program;
  if (state_->btf) {
    MESORIG_ASSIGN_OR_RETURN(btf_program, state_->BuildMaterial(Material::kBtf, true));
    state_->SetScene(btf_program.name(), true);
  }
  if (state_->plain) {
    MESORIG_ASSIGN_OR_RETURN(plain_program, state_->BuildMaterial(Material::kPlain, true));
    state_->SetScene(plain_program.name(), true);
  }
  target.Bind();
  state_->DrawObjects(btf_program.name(), plain_program.name());
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
