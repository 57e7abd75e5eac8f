#pragma once
// Silhouettes of the mesostructure (Wang et al. 2005, Sec. 4.1): where does the viewing ray first
// meet the relief that an object wears?
//
// An object's layers are peeled from front to back. Each pass finds, per pixel, the next interval
// of the ray inside the (closed) object: the back face p_b where it leaves, the front face p_f
// where it entered. The relief is met at d_f behind p_f as seen from the front, and at d_b before
// p_b as seen from behind (the MDF's lookup there is for -v). It is hit where d_f + d_b <= |p_f -
// p_b|; elsewhere the ray passes through to the next layer. Passes go on until an occlusion query
// finds no interval left, at most SilhouetteSettings::max_passes. Every object is peeled by itself,
// so that objects may touch or cut each other; they meet in the depth buffer.
//
// On the surface (DESIGN, "On a mesh"): v_t = J^-1 v with J = d(surface)/d(texture), its third
// column the normal times the square root of the area stretch; d = D(v_t/|v_t|)/|v_t|. Where J is
// singular there is no map and d = 0: the reference surface itself is seen.
//
// Deviation from the paper: its rays are straight in the sample's space, but the surface bends away
// under them. On a ball of radius R under a constant depth h the straight test finds the radius
// sqrt(R^2 - R h), R - h/2 to first order, where the truth is R - h. So the ray's depth below the
// surface is taken as the cubic with depth 0 at both ends and slopes c_f = v.n_f, -c_b = v.n_b
// there, and D is looked up along the secant from p_f to where the relief is met:
//   v.n is replaced by (1 - s)((1 - s) c_f + s c_b), s = d / |p_f - p_b|, at most 1/2,
// found by iteration from s = 0. A shallower ray meets a height field later, so that the iteration
// rises to the first hit. It gives sqrt(R^2 - 2 R h) = R - h - h^2/(2R) on the ball.
// SilhouetteSettings::follow_curvature = false is the paper's test.
//
// Between measured views and texels D is interpolated as the depth D v.z below the reference plane,
// which for a plane is exact at any spacing of the views. Never across a step: of the twelve
// samples (three views, four texels) those within step_mm of each other are one layer, and only the
// layer that carries the most weight is averaged. Beyond the measured cone: the nearest direction's
// D. Measured on domes with steep rims, 12 degrees between the views, curved rays, against the
// traced truth (tests/renderer/gl/silhouette_truth_test.cc), IoU in the band at the silhouette:
// 0.44 without an MDF; 0.79 nearest sample alone, 0.80 layer of the nearest sample, 0.81 heaviest
// layer; 0.82 a plain mean, whose surfaces across steps nobody measured. Straight rays: 0.67 in
// each case. D v.z kept beyond the cone (instead of D): 0.59 with curved rays, 0.69 with straight
// ones.

#include <array>
#include <span>

#include "processing/btf/mdf.h"
#include "renderer/gl/context.h"
#include "renderer/gl/gl_mesh.h"
#include "renderer/scene/scene.h"

namespace mesorig::renderer {

struct SilhouettePasses {
  int passes = 0;          // peeled; of several objects the most
  bool exhausted = false;  // max_passes was reached with intervals left: they are seen through
};

// What the passes write, one value a pixel.
class SilhouetteTarget {
 public:
  static StatusOr<SilhouetteTarget> Create(int width, int height);
  // Per pixel (triangle's number + 1, mm from there to the relief); (0, 0) where nothing is hit.
  GLuint hit() const { return hit_.name(); }

 private:
  friend class Silhouettes;
  int width_ = 0, height_ = 0;
  GlTexture hit_;
  std::array<GlTexture, 2> crossing_;  // of this pass and of the one before, in turn
  GlTexture toward_;
  GlRenderbuffer back_depth_, hit_depth_;
  std::array<GlFramebuffer, 2> back_;
  GlFramebuffer front_;
};

// Lives on the context's thread; keeps nothing of the MDF.
class Silhouettes {
 public:
  // InvalidArgument for an MDF that does not fit this driver, or with a distance that is NaN,
  // infinite or negative (the message names view and texel).
  static StatusOr<Silhouettes> Create(const btf::Mdf& mdf, const Scene& scene,
                                      const GlLimits& limits);
  // Peels `mesh` (uploaded with its stretches) into `target`. Changes the framebuffer, the
  // viewport, the culled side, and texture units 0 to 6.
  SilhouettePasses Find(const GlMesh& mesh, const SilhouetteTarget& target) const;

 private:
  bool PeelBack(const GlMesh& mesh, const SilhouetteTarget& target, int pass) const;
  void TestFront(const GlMesh& mesh, const SilhouetteTarget& target, int pass) const;
  void SetMesh(GLuint program, const GlMesh& mesh) const;

  int max_passes_ = 0;
  double width_mm_ = 0, height_mm_ = 0;  // of the sample
  GlTexture layers_;
  BufferTexture direction_rows_, direction_map_;
  GlProgram back_, front_;
};

// InvalidArgument unless BTF and MDF are of the same sample: the same reference plane and extent
// (to 1e-3; where the BTF does not know its pitch only the aspect counts).
Status CheckSameSample(int btf_width, int btf_height, double btf_pitch_mm, double btf_h_ref_mm,
                       const btf::MdfHeader& mdf);

// The step that `settings` asks for, mm.
double StepMm(const SilhouetteSettings& settings, const btf::MdfHeader& mdf);

}  // namespace mesorig::renderer
