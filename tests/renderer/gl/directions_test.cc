// The shader's interpolation is the CPU's: the same weights for the same directions, inside and
// beyond the measured cone.

#include <gtest/gtest.h>

#include <optional>
#include <random>

#include "renderer/gl/context.h"
#include "renderer/gl/direction_tables.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/shaders.h"
#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

constexpr char kHarness[] = R"(
layout(local_size_x = 64) in;
layout(std430, binding = 6) readonly buffer Asked { vec4 asked[]; };
layout(std430, binding = 7) writeonly buffer Answers { vec4 answers[]; };
layout(location = 0) uniform int map_first;
void main() {
  uint i = gl_GlobalInvocationID.x;
  if (i >= asked.length()) return;
  Interpolation found = Interpolate(map_first, asked[i].xyz);
  answers[2 * i] = vec4(found.weight, HorizonScale(found.direction, asked[i].xyz));
  answers[2 * i + 1] = vec4(vec3(found.index), 0.0);
}
)";

struct Answer {
  btf::DirectionWeights weights;
  double horizon_scale = 0;
};

// Runs shaders/directions.glsl over `asked` with the second of two sets, so that offsets count.
StatusOr<std::vector<Answer>> AskShader(const btf::DirectionInterpolator& first,
                                        const btf::DirectionInterpolator& set,
                                        const std::vector<std::array<float, 4>>& asked) {
  DirectionTables tables;
  tables.Append(first);
  tables.Append(set);
  MESORIG_ASSIGN_OR_RETURN(
      const GlProgram program,
      BuildProgram("harness",
                   {{GL_COMPUTE_SHADER, {"#version 450 core\n", kDirectionsGlsl, kHarness}}}));
  const BufferTexture rows = MakeBufferTexture(GL_RGBA32F, tables.rows),
                      map = MakeBufferTexture(GL_R32F, tables.map);
  const GlBuffer questions = MakeBuffer(asked),
                 answers = MakeBuffer(std::vector<std::array<float, 8>>(asked.size()));
  glBindTextureUnit(2, rows.texture.name());
  glBindTextureUnit(3, map.texture.name());
  const GLuint names[] = {questions.name(), answers.name()};
  glBindBuffersBase(GL_SHADER_STORAGE_BUFFER, 6, 2, names);
  glProgramUniform1i(program.name(), 0, DirectionTables::kMapSize * DirectionTables::kMapSize);
  glUseProgram(program.name());
  glDispatchCompute(static_cast<GLuint>(asked.size() + 63) / 64, 1, 1);
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  std::vector<std::array<float, 8>> raw(asked.size());
  glGetNamedBufferSubData(answers.name(), 0, static_cast<GLsizeiptr>(raw.size() * 32), raw.data());
  MESORIG_RETURN_IF_ERROR(CheckGl("harness"));
  std::vector<Answer> result;
  for (const auto& r : raw) {
    Answer answer;
    for (size_t k = 0; k < 3; ++k) {
      answer.weights.weight[k] = r[k];
      answer.weights.index[k] = static_cast<int>(r[4 + k]);
    }
    answer.horizon_scale = r[3];
    result.push_back(answer);
  }
  return result;
}

struct NamedSet {
  const char* name;
  std::vector<Vec3> directions;
};

std::vector<Vec3> Scattered(int count) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform;
  std::vector<Vec3> directions;
  for (int i = 0; i < count; ++i) {
    directions.push_back(
        DirectionFromAngles(std::acos(0.2 + 0.8 * uniform(random)), 2 * kPi * uniform(random)));
  }
  return directions;
}

// 6 turntable positions x 8 cameras, as the demo's rig has them.
std::vector<Vec3> Grid() {
  std::vector<Vec3> directions;
  for (int t = 0; t < 6; ++t) {
    for (int c = 0; c < 8; ++c) {
      directions.push_back(DirectionFromAngles(RadFromDeg(5 + 10 * c), 2 * kPi * t / 6));
    }
  }
  return directions;
}

class DirectionsTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = GlContext::Create();
    if (!context.ok()) GTEST_SKIP() << context.status();
    context_.emplace(*std::move(context));
  }
  std::optional<GlContext> context_;
};

TEST_F(DirectionsTest, ShaderAgreesWithTheInterpolator) {
  const NamedSet sets[] = {
      {"grid", Grid()},
      {"rings", Rings(RadFromDeg(75), RadFromDeg(15))},
      {"dense rings", Rings(RadFromDeg(85), RadFromDeg(4))},
      {"scattered", Scattered(60)},
      {"triangle", {DirectionFromAngles(0.3, 0), DirectionFromAngles(0.6, 2), {0, 0, 1}}},
      {"one side only",
       {DirectionFromAngles(0.9, 1), DirectionFromAngles(1.1, 1.5), DirectionFromAngles(1.2, 0.6),
        DirectionFromAngles(0.7, 0.8)}},
      {"one", {DirectionFromAngles(0.4, 1)}},
      {"two", {DirectionFromAngles(0.4, 1), DirectionFromAngles(0.9, 3)}},
      {"arc",
       {DirectionFromAngles(0.8, 1),
        DirectionFromAngles(0.2, 1),
        {0, 0, 1},
        DirectionFromAngles(0.7, 1 + kPi)}},
  };
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<std::array<float, 4>> asked;
  for (int i = 0; i < 4000; ++i) {
    const Vec3 d = Normalized({normal(random), normal(random), std::abs(normal(random)) - 0.05});
    asked.push_back({static_cast<float>(d.x), static_cast<float>(d.y), static_cast<float>(d.z), 0});
  }
  const auto first = btf::DirectionInterpolator::Build(Scattered(17));
  ASSERT_TRUE(first.ok());
  for (const NamedSet& set : sets) {
    SCOPED_TRACE(set.name);
    const auto interpolator = btf::DirectionInterpolator::Build(set.directions);
    ASSERT_TRUE(interpolator.ok());
    const auto answers = AskShader(*first, *interpolator, asked);
    ASSERT_TRUE(answers.ok()) << answers.status();
    // What is interpolated: a smooth function, so that a tie between triangles does not matter.
    const auto sum = [&](const btf::DirectionWeights& w) {
      Vec3 d;
      for (size_t k = 0; k < 3; ++k) {
        if (w.weight[k] > 0) {
          d = d + w.weight[k] * set.directions.at(static_cast<size_t>(w.index[k]));
        }
      }
      return d;
    };
    int differing = 0;
    for (size_t i = 0; i < asked.size(); ++i) {
      const Vec3 d = {asked[i][0], asked[i][1], asked[i][2]};
      const auto cpu = interpolator->Lookup(d);
      const auto& gpu = (*answers)[i];
      EXPECT_NEAR(gpu.weights.weight[0] + gpu.weights.weight[1] + gpu.weights.weight[2], 1, 1e-5);
      const double scale = btf::HorizonScale(*interpolator, cpu, d);
      if (Norm(sum(cpu) - sum(gpu.weights)) > 1e-4 ||
          std::abs(scale - gpu.horizon_scale) > 1e-3 * std::max(1.0, scale)) {
        ++differing;
      }
    }
    // Ties (a direction as near to one side of the hull as to the other) may fall either way.
    EXPECT_LE(differing, 4);
  }
}

}  // namespace
}  // namespace mesorig::renderer
