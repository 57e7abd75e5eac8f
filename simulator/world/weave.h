#pragma once
// A plain weave of two thread colours with a raised letter F in a third: a relief whose mirror image
// or turned image is another one, so that a wrong sign anywhere shows. Sample frame, millimetres.

#include "simulator/world/surface.h"

namespace mesorig::world {

struct WeaveShape {
  double pitch_mm = 4;          // from thread to thread
  double thread_width_mm = 3.6;
  double thread_height_mm = 1.2;  // rise of a thread's middle over its edges (a parabola)
  double sway_mm = 0.8;         // how far threads go up and down over and under each other
  double base_mm = 1;           // height of a thread's edge half way between over and under
  double twist_mm = 1.8;        // wavelength of the colour along a thread
  double twist_contrast = 0.1;  // relative amplitude of the colour
  Material warp, weft, ground;  // threads along y, along x, and what is seen between them
  // The letter: strokes of letter_stroke_mm around its centre, letter_height_mm tall along y. Its
  // top lies at letter_top_mm and follows the weave below by letter_follow; its flanks are
  // letter_ramp_mm wide.
  double letter_height_mm = 24, letter_width_mm = 15, letter_stroke_mm = 5;
  double letter_top_mm = 3.2, letter_follow = 0.25, letter_ramp_mm = 1.2;
  double letter_x_mm = 0, letter_y_mm = 0;
  Material letter;
};

double WeaveHeight(const WeaveShape& shape, double x, double y);
Material WeaveMaterial(const WeaveShape& shape, double x, double y);
// 1 on the letter's top, 0 beyond its flanks.
double LetterCoverage(const WeaveShape& shape, double x, double y);

}  // namespace mesorig::world
