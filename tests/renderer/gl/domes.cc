#include "tests/renderer/gl/domes.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "tests/renderer/gl/synthetic.h"

namespace mesorig::renderer {
namespace {

// Length along `direction` from p until the relief is met; `longest` where it is not.
double March(Vec3 p, Vec3 direction, double longest) {
  const auto above = [&](double t) {
    const Vec3 q = p + t * direction;
    return q.z > DomesHeight(q.x, q.y);
  };
  double near = 0, far = 0;
  while (above(far)) {
    if (far >= longest) return longest;
    near = far;
    far += 0.08;
  }
  for (int i = 0; i < 12; ++i) (above((near + far) / 2) ? near : far) = (near + far) / 2;
  return far;
}

Vec3 TexelOf(int texels, int x, int y) {
  const double pitch = kDomesSize / texels;
  return {(x + 0.5 - texels / 2.0) * pitch, (texels / 2.0 - y - 0.5) * pitch, kDomesReference};
}

}  // namespace

double DomesHeight(double x, double y) {
  double h = kDomesLowest + 0.4 * (1 - std::cos(2 * kPi * x / 20) * std::cos(2 * kPi * y / 10)) / 2;
  const auto dome = [&](double cx, double cy, double radius, double height) {
    const double dx = std::remainder(x - cx, kDomesSize), dy = std::remainder(y - cy, kDomesSize);
    const double r = std::hypot(dx, dy) / radius;
    if (r < 1) h = std::max(h, kDomesLowest + height * std::sqrt(1 - r * r * r * r));
  };
  dome(-12, 11, 5, 3.6);
  dome(6, 13, 4, 2.8);
  dome(12, -4, 5.5, 3.3);
  dome(-6, -7, 4.5, 3.0);
  dome(-15, -15, 3, 3.6);
  dome(4, -16, 3.5, 2.4);
  return h;
}

btf::Mdf DomesMdf(int texels, const std::vector<Vec3>& views) {
  return MakeMdf(texels, kDomesSize / texels, views,
                 [=](int x, int y, Vec3 v) { return March(TexelOf(texels, x, y), -v, 1e3); });
}

btf::SampledBtf DomesBtf(int texels, const std::vector<Vec3>& views,
                         const std::vector<Vec3>& lights) {
  btf::SampledBtf btf = MakeBtf(
      texels, texels, kDomesSize / texels, views, lights, [=](int x, int y, Vec3 v, Vec3 l) {
        const Vec3 p = TexelOf(texels, x, y);
        const Vec3 q = p - March(p, -v, 1e3) * v;
        constexpr double kStep = 0.01;
        const Vec3 n =
            Normalized({DomesHeight(q.x - kStep, q.y) - DomesHeight(q.x + kStep, q.y),
                        DomesHeight(q.x, q.y - kStep) - DomesHeight(q.x, q.y + kStep), 2 * kStep});
        const double cosine = Dot(n, l);
        const double above = kDomesReference - q.z;
        if (cosine <= 0 || March(q + 0.1 * n, l, above / l.z) < above / l.z) return 0.0;
        return (q.z > kDomesLowest + 0.5 ? 0.7 : 0.3) / kPi * cosine;
      });
  btf.mutable_header().h_ref_mm = kDomesReference;
  return btf;
}

std::string DomesObj(int cells) {
  std::string text;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      const double x = kDomesSize * i / cells - kDomesSize / 2;
      const double y = kDomesSize * j / cells - kDomesSize / 2;
      text += fmt::format("v {:.5f} {:.5f} {:.5f}\n", x, y, DomesHeight(x, y));
    }
  }
  for (int j = 0; j < cells; ++j) {
    for (int i = 1; i <= cells; ++i) {
      const int a = j * (cells + 1) + i, b = a + cells + 1;
      text += fmt::format("f {} {} {}\nf {} {} {}\n", a, a + 1, b + 1, a, b + 1, b);
    }
  }
  return text;
}

}  // namespace mesorig::renderer
