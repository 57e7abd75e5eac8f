#include "renderer/gl/gl_objects.h"

#include <numeric>

namespace mesorig::renderer {
namespace {

StatusOr<GLuint> CompileStage(std::string_view name, const ShaderStage& stage) {
  const std::string source =
      std::accumulate(stage.pieces.begin(), stage.pieces.end(), std::string());
  const GLuint shader = glCreateShader(stage.type);
  const char* text = source.c_str();
  glShaderSource(shader, 1, &text, nullptr);
  glCompileShader(shader);
  GLint ok = GL_FALSE;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &ok);
  if (ok == GL_TRUE) return shader;
  char log[2048] = {};
  glGetShaderInfoLog(shader, sizeof log, nullptr, log);
  glDeleteShader(shader);
  return Internal("OpenGL: shader {} does not compile: {}", name, log);
}

}  // namespace

StatusOr<GlProgram> BuildProgram(std::string_view name, const std::vector<ShaderStage>& stages) {
  GlProgram program(glCreateProgram());
  for (const ShaderStage& stage : stages) {
    MESORIG_ASSIGN_OR_RETURN(const GLuint shader, CompileStage(name, stage));
    glAttachShader(program.name(), shader);
    glDeleteShader(shader);  // the program keeps it
  }
  glLinkProgram(program.name());
  GLint ok = GL_FALSE;
  glGetProgramiv(program.name(), GL_LINK_STATUS, &ok);
  if (ok == GL_TRUE) return program;
  char log[2048] = {};
  glGetProgramInfoLog(program.name(), sizeof log, nullptr, log);
  return Internal("OpenGL: shader {} does not link: {}", name, log);
}

}  // namespace mesorig::renderer
