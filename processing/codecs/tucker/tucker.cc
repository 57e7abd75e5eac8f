#include "processing/codecs/tucker/tucker.h"

#include <algorithm>
#include <cmath>

#include "processing/codecs/linear/linear_planes.h"
#include "protocol/base/check.h"

namespace mesorig::codecs::tucker {
namespace {

constexpr float kLargestVector = 0x1p110f;  // 4096 terms of them stay in float
constexpr double kMostBytes = 2147483648.0;  // of vectors, once multiplied out

// h_a(v, l) = s_a sum over b, c of Z_abc V_b(v) L_c(l) of what is present, as LinearFactors has it.
std::vector<float> Vectors(const btf::BtfFileInfo& info, const Core& core, size_t stride) {
  const auto terms = static_cast<size_t>(core.terms), n = static_cast<size_t>(core.light_terms);
  const auto view_terms = static_cast<size_t>(core.view_terms);
  const size_t views = info.header.views.size(), lights = info.header.lights.size();
  std::vector<float> h(views * lights * 3 * stride, 0.0f);
  std::vector<float> of_view(n * stride);  // [light term][term]: sum over b
  for (size_t v = 0; v < views; ++v) {
    std::fill(of_view.begin(), of_view.end(), 0.0f);
    for (size_t a = 0; a < terms; ++a) {
      for (size_t b = 0; b < view_terms; ++b) {
        const float factor = core.scales[a] * core.views[v * view_terms + b];
        const float* const z = core.values.data() + (a * view_terms + b) * n;
        for (size_t c = 0; c < n; ++c) of_view[c * stride + a] += factor * z[c];
      }
    }
    for (size_t row = 0; row < lights * 3; ++row) {
      if (info.present[v * lights + row / 3] == 0) continue;
      float* const to = h.data() + (v * lights * 3 + row) * stride;
      for (size_t c = 0; c < n; ++c) {
        const float factor = core.lights[row * n + c];
        for (size_t a = 0; a < terms; ++a) to[a] += factor * of_view[c * stride + a];
      }
    }
  }
  return h;
}

}  // namespace

StatusOr<std::unique_ptr<EncodedBtf>> TuckerBtf::Create(btf::BtfFileInfo info, Core core,
                                                        Quantisation quantisation, float log_floor,
                                                        std::vector<float> g) {
  const btf::BtfHeader& header = info.header;
  LinearFactors factors;
  factors.shape.terms = core.terms;
  factors.quantisation = quantisation;
  factors.log_floor = log_floor;
  const auto stride = static_cast<size_t>(factors.shape.stride());
  const double bytes = 12.0 * static_cast<double>(info.present.size()) * static_cast<double>(stride);
  if (bytes > kMostBytes) {
    return InvalidArgument("{} terms of {} views x {} lights are {:.1f} GiB of vectors, at most {:.1f} are taken",
                           core.terms, header.view_count(), header.light_count(),
                           bytes * 0x1p-30, kMostBytes * 0x1p-30);
  }
  MESORIG_CHECK(core.views.size() == header.views.size() * static_cast<size_t>(core.view_terms));
  MESORIG_CHECK(core.lights.size() ==
                header.lights.size() * 3 * static_cast<size_t>(core.light_terms));
  factors.h = Vectors(info, core, stride);
  for (const float x : factors.h) {
    if (std::abs(x) <= kLargestVector) continue;
    return InvalidArgument("parts Z, V and L multiply out to {:g}, at most {:g} is permitted", x,
                           kLargestVector);
  }
  factors.g = std::move(g);
  factors.scales.assign(stride, 1.0f);
  std::copy(core.scales.begin(), core.scales.end(), factors.scales.begin());
  MESORIG_ASSIGN_OR_RETURN(auto expanded, LinearBtf::Create(std::move(info), std::move(factors)));
  return std::unique_ptr<EncodedBtf>(
      new TuckerBtf(std::move(core), std::unique_ptr<LinearBtf>(
                                         static_cast<LinearBtf*>(expanded.release()))));
}

std::vector<btf::Plane> TuckerBtf::Planes() const {
  const btf::BtfHeader& h = info().header;
  const LinearFactors& f = expanded_->factors();
  const Quantisation small = OfCore(f.quantisation);
  const auto n = static_cast<size_t>(core_.light_terms);
  std::vector<float> lights;  // B, G, R: sorted by name, as planes are when read
  for (size_t c = 3; c-- > 0;) {
    for (size_t l = 0; l < h.lights.size(); ++l) {
      const float* const from = core_.lights.data() + (3 * l + c) * n;
      lights.insert(lights.end(), from, from + n);
    }
  }
  return {FloorPlane(f.log_floor),
          ScalePlane(core_.terms, 1, core_.scales),
          WeightPlane("G", h, f, 0),
          QuantisedPlane("V", core_.view_terms, h.view_count(), {"V"}, small, core_.views),
          QuantisedPlane("L", core_.light_terms, h.light_count(), {"B", "G", "R"}, small,
                         std::move(lights)),
          QuantisedPlane("Z", core_.light_terms, core_.view_terms, TermChannels(core_.terms), small,
                         core_.values)};
}

namespace {

// The number of columns of a part that is there, 0 where it is not.
int WidthOf(const btf::CodedBtf& file, const char* part) {
  const auto at = file.planes.find(part);
  return at == file.planes.end() ? 0 : at->second.width;
}

StatusOr<Core> ReadCore(btf::CodedBtf& file, int terms) {
  const btf::BtfHeader& h = file.info.header;
  Core core;
  core.terms = terms;
  core.view_terms = WidthOf(file, "V");
  core.light_terms = WidthOf(file, "L");
  if (core.view_terms < 1 || core.view_terms > h.view_count() || core.light_terms < 1 ||
      core.light_terms > 3 * h.light_count()) {
    return InvalidArgument("{} view terms and {} light terms, permitted are 1 to {} and 1 to {}",
                           core.view_terms, core.light_terms, h.view_count(), 3 * h.light_count());
  }
  Quantisation q = Quantisation::kHalf;
  MESORIG_ASSIGN_OR_RETURN(btf::Plane views,
                           TakePlane(file, "V", core.view_terms, h.view_count(), {"V"}));
  MESORIG_ASSIGN_OR_RETURN(core.views, Dequantised(std::move(views), q));
  MESORIG_ASSIGN_OR_RETURN(btf::Plane lights, TakePlane(file, "L", core.light_terms, h.light_count(),
                                                        {"B", "G", "R"}));
  MESORIG_ASSIGN_OR_RETURN(const std::vector<float> bgr, Dequantised(std::move(lights), q));
  const auto n = static_cast<size_t>(core.light_terms);
  core.lights.resize(bgr.size());
  for (size_t row = 0; row < bgr.size() / n; ++row) {
    const size_t l = row % h.lights.size(), c = 2 - row / h.lights.size();
    std::copy_n(bgr.data() + row * n, n, core.lights.data() + (3 * l + c) * n);
  }
  MESORIG_ASSIGN_OR_RETURN(btf::Plane values, TakePlane(file, "Z", core.light_terms, core.view_terms,
                                                        TermChannels(terms)));
  MESORIG_ASSIGN_OR_RETURN(core.values, Dequantised(std::move(values), q));
  MESORIG_ASSIGN_OR_RETURN(core.scales, TakeScales(file, terms, 1));
  return core;
}

class TuckerDecoder final : public Decoder {
 public:
  std::string_view name() const override { return kName; }
  std::string_view paper() const override {
    return "Mueller et al. 2004, Sec. 3.2.2; Vasilescu and Terzopoulos 2004";
  }
  int version() const override { return kVersion; }
  StatusOr<std::unique_ptr<EncodedBtf>> Decode(btf::CodedBtf file) const override {
    LinearFactors factors;
    MESORIG_ASSIGN_OR_RETURN(factors.shape.terms, CountTerms(file, "G"));
    MESORIG_ASSIGN_OR_RETURN(factors.log_floor, TakeFloor(file));
    MESORIG_RETURN_IF_ERROR(TakeWeights(file, "G", factors));
    MESORIG_ASSIGN_OR_RETURN(Core core, ReadCore(file, factors.shape.terms));
    MESORIG_RETURN_IF_ERROR(CheckNothingLeft(file));
    return TuckerBtf::Create(std::move(file.info), std::move(core), factors.quantisation,
                             factors.log_floor, std::move(factors.g));
  }
};

}  // namespace

const Decoder& TheDecoder() {
  static const TuckerDecoder decoder;
  return decoder;
}

}  // namespace mesorig::codecs::tucker
