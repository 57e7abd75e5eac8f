#include "processing/report/published.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <vector>

#include "processing/report/html.h"

namespace mesorig::report {
namespace {

constexpr double kMiB = 1048576.0;

// Müller et al. 2004, Fig. 14: 6561 8-bit RGB images of 256 x 256 texels, 81 views x 81 lights; 16 bit
// for PCMF, 8 bit for the others.
constexpr double kTexels = 65536, kViews = 81, kLights = 81, kPairs = kViews * kLights, kRgb = 3;

struct Size {
  const char* method;
  double published_mb;
  const char* why;    // what the printed size follows from
  const char* codec;  // ours, "" where there is none
  double ours;        // bytes of its factors before packing, at that precision; 0 without a codec
};

// Ours: what the planes of each codec's README hold.
const std::vector<Size>& Survey() {
  static const std::vector<Size> sizes = {
      {"original", 1.2 * 1024, "6561 images x 65,536 texels x 3 bytes", "raw", kPairs * kTexels * kRgb},
      {"SLAF, 2 lobes", 32, "", "", 0},
      {"RF, polynomial a view", 106, "6 coefficients and a colour a texel and view", "rf-ptm",
       kTexels * kViews * 6 * kRgb},
      {"CMF, 4 factors", 60, "4 x 81 x 3 bytes a texel", "cmf, 1 term",
       kTexels * (kViews + kRgb * kLights + 64 + kRgb * 64)},
      {"PVMF, 8 terms", 121, "8 x 3 x 81 bytes a texel: colours apart", "pvmf, 8 terms",
       kTexels * kViews * 8 + kPairs * kRgb * 8},
      {"PCMF, 32 clusters of 8 terms", 11, "2 bytes: 8 a texel, 32 x 8 x 6561 x 3",
       "pcmf, 8 terms of 32 clusters", 2 * (kTexels * 8 + 32 * kPairs * kRgb * 9)},
  };
  return sizes;
}

// Wang et al. 2005, Table 1: 4 terms; views and lights 12 x 5 or 12 x 8 each.
struct Sample {
  const char* names;
  double side, directions, published_mb;
};
constexpr Sample kWang[] = {{"blue pipe, brick, block", 64, 60, 1.3},
                            {"grass", 64, 96, 5.3},
                            {"peanut, weave", 128, 96, 7.5}};
// Eigen-textures of 4 terms, and their weights as float.
double ViewSvdBytes(const Sample& s, double bytes_a_value) {
  return s.side * s.side * s.directions * 4 * kRgb * bytes_a_value + 4 * 4 * s.directions;
}

std::string Mb(double bytes) { return fmt::format("{:.3g}", bytes / kMiB); }

}  // namespace

std::string PublishedTables() {
  std::vector<std::vector<std::string>> survey = {
      {"Müller et al. 2004, Fig. 14", "MB there", "which follows from", "our codec", "MB of it there"}};
  for (const Size& s : Survey()) {
    survey.push_back({s.method, fmt::format("{:.4g}", s.published_mb), *s.why == 0 ? "–" : s.why,
                      *s.codec == 0 ? "none" : s.codec, s.ours > 0 ? Mb(s.ours) : "–"});
  }
  std::vector<std::vector<std::string>> wang = {{"Wang et al. 2005, Table 1", "texels", "directions",
                                                 "MB there", "view-svd as float", "as half",
                                                 "as bytes"}};
  for (const Sample& s : kWang) {
    wang.push_back({s.names, fmt::format("{0} x {0}", s.side), fmt::format("{0} x {0}", s.directions),
                    fmt::format("{:.1f}", s.published_mb), Mb(ViewSvdBytes(s, 4)),
                    Mb(ViewSvdBytes(s, 2)), Mb(ViewSvdBytes(s, 1))});
  }
  return Table(survey) +
         Paragraph("81 views x 81 lights of 256 x 256 texels, 8 bits a number but 16 for PCMF. Ours are "
                   "computed for that data from what our files hold, before packing; MB are 2^20 bytes "
                   "here. Printed sizes come without errors: none can be set beside ours.") +
         Table(wang) +
         Paragraph("Four terms of RGB need what stands on the right; the printed sizes are smaller than "
                   "even bytes would be (but for grass), and do not follow from four terms of RGB floats. "
                   "Ours do: they are the sizes before packing.");
}

nlohmann::json PublishedJson() {
  nlohmann::json rows = nlohmann::json::array();
  for (const Size& s : Survey()) {
    nlohmann::json row{{"source", "Müller et al. 2004, Fig. 14"},
                       {"method", s.method},
                       {"published_bytes", s.published_mb * kMiB}};
    if (s.ours > 0) row.update({{"codec", s.codec}, {"ours_bytes", s.ours}});
    rows.push_back(std::move(row));
  }
  for (const Sample& s : kWang) {
    rows.push_back({{"source", "Wang et al. 2005, Table 1"},
                    {"method", s.names},
                    {"published_bytes", s.published_mb * kMiB},
                    {"codec", "view-svd, 4 terms, half"},
                    {"ours_bytes", ViewSvdBytes(s, 2)}});
  }
  return rows;
}

}  // namespace mesorig::report
