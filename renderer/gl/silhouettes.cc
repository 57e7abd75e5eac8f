#include "renderer/gl/silhouettes.h"

#include <algorithm>
#include <cmath>

#include "processing/btf/spherical_interpolation.h"
#include "renderer/gl/direction_tables.h"
#include "renderer/gl/shaders.h"

namespace mesorig::renderer {
namespace {

constexpr float kNone = 1e30f;  // shaders/mdf.glsl
constexpr int kBendSteps = 8;   // it is there in two or three, but for the rays that just miss

// Places of the uniforms in shaders/mesh.vert and shaders/mdf.glsl.
enum Location : GLint {
  kClipFromWorld = 0,
  kWorldFromObject = 1,
  kUnitsPerMm = 2,
  kEye = 3,
  kSampleMmPerMm = 16,
  kStepMm = 17,
  kBendStepCount = 18,
  kLargestDistance = 19,
};

GlTexture MakeTexture(GLenum format, int width, int height) {
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  glTextureStorage2D(name, 1, format, width, height);
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureParameteri(name, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  return GlTexture(name);
}

GlRenderbuffer MakeDepth(int width, int height) {
  GLuint name = 0;
  glCreateRenderbuffers(1, &name);
  glNamedRenderbufferStorage(name, GL_DEPTH_COMPONENT32F, width, height);
  return GlRenderbuffer(name);
}

GlFramebuffer MakeFramebuffer(const std::vector<GLuint>& colours, const GlRenderbuffer& depth) {
  GLuint name = 0;
  glCreateFramebuffers(1, &name);
  std::vector<GLenum> attachments;
  for (GLuint colour : colours) {
    attachments.push_back(GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(attachments.size()));
    glNamedFramebufferTexture(name, attachments.back(), colour, 0);
  }
  glNamedFramebufferDrawBuffers(name, static_cast<GLsizei>(attachments.size()), attachments.data());
  glNamedFramebufferRenderbuffer(name, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, depth.name());
  return GlFramebuffer(name);
}

void Clear(const GlFramebuffer& framebuffer, GLint colour, float x) {
  const GLfloat values[] = {x, 0, 0, 0};
  glClearNamedFramebufferfv(framebuffer.name(), GL_COLOR, colour, values);
}

void ClearDepth(const GlFramebuffer& framebuffer) {
  const GLfloat far = 1;
  glClearNamedFramebufferfv(framebuffer.name(), GL_DEPTH, 0, &far);
}

// D v.z of every view, a layer a view, nearest filtering only: what is between is the shader's.
StatusOr<GlTexture> UploadDepths(const btf::Mdf& mdf, const GlLimits& limits) {
  const btf::MdfHeader& header = mdf.header();
  if (header.view_count() > limits.array_layers ||
      std::max(header.width, header.height) > limits.texture_size) {
    return InvalidArgument(
        "the MDF has {} views of {} x {} texels; permitted by this OpenGL are at most {} views and "
        "{} texels a side",
        header.view_count(), header.width, header.height, limits.array_layers, limits.texture_size);
  }
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D_ARRAY, 1, &name);
  GlTexture texture(name);
  glTextureStorage3D(name, 1, GL_R32F, header.width, header.height, header.view_count());
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTextureParameteri(name, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  std::vector<float> depths(header.texel_count());
  for (int view = 0; view < header.view_count(); ++view) {
    const auto distances = mdf.Distance(view);
    const double cosine = header.views[static_cast<size_t>(view)].z;
    for (size_t i = 0; i < depths.size(); ++i) {
      if (!(distances[i] >= 0 && distances[i] <= 1e6f)) {
        return InvalidArgument(
            "the MDF's distance at view {}, texel ({}, {}) is {} mm; permitted is 0 to 1e6", view,
            i % static_cast<size_t>(header.width), i / static_cast<size_t>(header.width),
            distances[i]);
      }
      depths[i] = static_cast<float>(distances[i] * cosine);
    }
    glTextureSubImage3D(name, 0, 0, 0, view, header.width, header.height, 1, GL_RED, GL_FLOAT,
                        depths.data());
  }
  MESORIG_RETURN_IF_ERROR(CheckGl("the MDF's texture"));
  return texture;
}

StatusOr<GlProgram> BuildPeel(std::string_view name, const char* fragment) {
  constexpr char kHead[] = "#version 450 core\n#define MESORIG_MDF\n#define MESORIG_STRETCH\n";
  return BuildProgram(name, {{GL_VERTEX_SHADER, {kHead, kMeshVertexGlsl}},
                             {GL_FRAGMENT_SHADER, {kHead, kDirectionsGlsl, kMdfGlsl, fragment}}});
}

}  // namespace

double StepMm(const SilhouetteSettings& settings, const btf::MdfHeader& mdf) {
  return settings.step_mm >= 0 ? settings.step_mm : 2 * mdf.pitch_mm;
}

Status CheckSameSample(int btf_width, int btf_height, double btf_pitch_mm, double btf_h_ref_mm,
                       const btf::MdfHeader& mdf) {
  const auto differ = [](double a, double b) { return !(std::abs(a - b) <= 1e-3 * std::abs(b)); };
  const double width_mm = mdf.width * mdf.pitch_mm, height_mm = mdf.height * mdf.pitch_mm;
  if (differ(btf_height * width_mm, btf_width * height_mm) ||
      (btf_pitch_mm > 0 && differ(btf_width * btf_pitch_mm, width_mm))) {
    return InvalidArgument(
        "the BTF covers {} x {} texels of {} mm, the MDF {} x {} of {} mm: they are not of the "
        "same "
        "part of a sample",
        btf_width, btf_height, btf_pitch_mm, mdf.width, mdf.height, mdf.pitch_mm);
  }
  if (btf_h_ref_mm > 0 && differ(btf_h_ref_mm, mdf.h_ref_mm)) {
    return InvalidArgument(
        "the BTF's reference plane is at {} mm, the MDF's at {} mm: permitted are files of one "
        "reference plane",
        btf_h_ref_mm, mdf.h_ref_mm);
  }
  return OkStatus();
}

StatusOr<SilhouetteTarget> SilhouetteTarget::Create(int width, int height) {
  SilhouetteTarget target;
  target.width_ = width;
  target.height_ = height;
  target.hit_ = MakeTexture(GL_RG32F, width, height);
  target.toward_ = MakeTexture(GL_RGBA32F, width, height);
  target.back_depth_ = MakeDepth(width, height);
  target.hit_depth_ = MakeDepth(width, height);
  target.front_ = MakeFramebuffer({target.hit_.name()}, target.hit_depth_);
  for (size_t i = 0; i < 2; ++i) {
    target.crossing_[i] = MakeTexture(GL_RGBA32F, width, height);
    target.back_[i] =
        MakeFramebuffer({target.crossing_[i].name(), target.toward_.name()}, target.back_depth_);
  }
  MESORIG_RETURN_IF_ERROR(CheckGl(fmt::format("peeling targets of {} x {} pixels", width, height)));
  for (const GlFramebuffer* framebuffer : {&target.front_, &target.back_[0], &target.back_[1]}) {
    const GLenum status = glCheckNamedFramebufferStatus(framebuffer->name(), GL_FRAMEBUFFER);
    if (status != GL_FRAMEBUFFER_COMPLETE) {
      return Unavailable("OpenGL: the driver refuses a peeling target of {} x {} pixels ({:#x})",
                         width, height, status);
    }
  }
  return target;
}

StatusOr<Silhouettes> Silhouettes::Create(const btf::Mdf& mdf, const Scene& scene,
                                          const GlLimits& limits) {
  const btf::MdfHeader& header = mdf.header();
  MESORIG_RETURN_IF_ERROR(btf::CheckMdfHeader(header));
  Silhouettes result;
  result.max_passes_ = scene.silhouettes.max_passes;
  result.width_mm_ = header.width * header.pitch_mm;
  result.height_mm_ = header.height * header.pitch_mm;
  MESORIG_ASSIGN_OR_RETURN(result.layers_, UploadDepths(mdf, limits));
  MESORIG_ASSIGN_OR_RETURN(const auto views, btf::DirectionInterpolator::Build(header.views));
  DirectionTables tables;
  tables.Append(views);
  result.direction_rows_ = MakeBufferTexture(GL_RGBA32F, tables.rows);
  result.direction_map_ = MakeBufferTexture(GL_R32F, tables.map);
  MESORIG_ASSIGN_OR_RETURN(result.back_, BuildPeel("peel_back", kPeelBackFragmentGlsl));
  MESORIG_ASSIGN_OR_RETURN(result.front_, BuildPeel("peel_front", kPeelFrontFragmentGlsl));
  const ImageSettings& image = scene.image;
  for (const GlProgram* program : {&result.back_, &result.front_}) {
    SetMatrix(program->name(), kClipFromWorld,
              Product(Projection(scene.camera, static_cast<double>(image.width) / image.height),
                      CameraFromWorld(scene.camera)));
    SetVector(program->name(), kEye, scene.camera.eye_mm);
  }
  const GLuint front = result.front_.name();
  glProgramUniform1f(front, kStepMm, static_cast<float>(StepMm(scene.silhouettes, header)));
  glProgramUniform1i(front, kBendStepCount, scene.silhouettes.follow_curvature ? kBendSteps : 0);
  float largest = 0;
  for (int view = 0; view < header.view_count(); ++view) {
    for (const float distance : mdf.Distance(view)) largest = std::max(largest, distance);
  }
  glProgramUniform1f(front, kLargestDistance, largest);
  MESORIG_RETURN_IF_ERROR(CheckGl("the MDF's tables"));
  return result;
}

void Silhouettes::SetMesh(GLuint program, const GlMesh& mesh) const {
  SetMatrix(program, kWorldFromObject, mesh.world_from_object);
  glProgramUniform2f(program, kUnitsPerMm, static_cast<float>(mesh.units_per_mm.x),
                     static_cast<float>(mesh.units_per_mm.y));
  glProgramUniform2f(program, kSampleMmPerMm, static_cast<float>(mesh.units_per_mm.x * width_mm_),
                     static_cast<float>(mesh.units_per_mm.y * height_mm_));
}

bool Silhouettes::PeelBack(const GlMesh& mesh, const SilhouetteTarget& target, int pass) const {
  const size_t now = static_cast<size_t>(pass % 2), before = 1 - now;
  const GlFramebuffer& framebuffer = target.back_[now];
  Clear(framebuffer, 0, kNone);
  ClearDepth(framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer.name());
  glBindTextureUnit(4, target.crossing_[before].name());
  glBindTextureUnit(5, target.hit_.name());
  glBindTextureUnit(6, 0);
  glCullFace(GL_FRONT);
  glUseProgram(back_.name());
  GLuint query = 0, any = 0;
  glCreateQueries(GL_ANY_SAMPLES_PASSED, 1, &query);
  glBeginQuery(GL_ANY_SAMPLES_PASSED, query);
  mesh.Draw();
  glEndQuery(GL_ANY_SAMPLES_PASSED);
  glGetQueryObjectuiv(query, GL_QUERY_RESULT, &any);
  glDeleteQueries(1, &query);
  glCullFace(GL_BACK);
  return any != 0;
}

void Silhouettes::TestFront(const GlMesh& mesh, const SilhouetteTarget& target, int pass) const {
  const size_t now = static_cast<size_t>(pass % 2), before = 1 - now;
  glBindFramebuffer(GL_FRAMEBUFFER, target.front_.name());
  glBindTextureUnit(0, layers_.name());
  glBindTextureUnit(2, direction_rows_.texture.name());
  glBindTextureUnit(3, direction_map_.texture.name());
  glBindTextureUnit(4, target.crossing_[before].name());
  glBindTextureUnit(5, target.crossing_[now].name());
  glBindTextureUnit(6, target.toward_.name());
  glUseProgram(front_.name());
  mesh.Draw();
}

SilhouettePasses Silhouettes::Find(const GlMesh& mesh, const SilhouetteTarget& target) const {
  SetMesh(back_.name(), mesh);
  SetMesh(front_.name(), mesh);
  glViewport(0, 0, target.width_, target.height_);
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_CULL_FACE);
  Clear(target.front_, 0, 0);
  // Cleared once: a later layer never replaces a hit.
  ClearDepth(target.front_);
  Clear(target.back_[1], 0, -1);  // before the first layer: in front of everything
  SilhouettePasses result;
  for (int pass = 0;; ++pass) {
    const bool any = PeelBack(mesh, target, pass);
    if (any && pass == max_passes_) {
      result.exhausted = true;
      break;
    }
    // The last one, without intervals, is for front faces that have no back face.
    TestFront(mesh, target, pass);
    if (!any) break;
    result.passes = pass + 1;
  }
  return result;
}

}  // namespace mesorig::renderer
