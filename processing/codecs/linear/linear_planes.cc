// Factors as planes of a file, and back (README.md has their names).

#include <algorithm>
#include <cmath>

#include "processing/codecs/linear/linear_planes.h"

namespace mesorig::codecs {
namespace {

constexpr int kMaxTerms = 4096, kMaxClusters = 2048;  // whole numbers in half up to there

std::string Numbered(char letter, int i) { return fmt::format("{}{:05}", letter, i); }

// Sorted by name, as planes are when read.
std::vector<std::string> VectorChannels(const LinearShape& shape) {
  std::vector<std::string> channels;
  const auto add = [&](const std::string& term) {
    for (const char* rgb : {"B", "G", "R"}) channels.push_back(term + "." + rgb);
  };
  if (shape.mean) add("mean");
  for (int k = 0; k < shape.terms; ++k) add(fmt::format("t{:04}", k));
  return channels;
}

// The place of a channel of VectorChannels among the terms: the mean stands first in the file and
// last in memory.
size_t TermOf(const LinearShape& shape, size_t channel) {
  const size_t k = channel / 3;
  if (!shape.mean) return k;
  return k == 0 ? static_cast<size_t>(shape.terms) : k - 1;
}

// Calls function(basis, value in memory, value in the plane, scale) for all of H.
template <typename Function>
void ForVectors(const btf::BtfHeader& header, const LinearShape& shape, int basis,
                const Function& function) {
  const size_t pairs = shape.pairs(header), stride = static_cast<size_t>(shape.stride());
  const size_t channels = VectorChannels(shape).size();
  for (size_t channel = 0; channel < channels; ++channel) {
    const size_t term = TermOf(shape, channel), rgb = 2 - channel % 3;
    for (size_t p = 0; p < pairs; ++p) {
      function(((static_cast<size_t>(basis) * pairs + p) * 3 + rgb) * stride + term,
               channel * pairs + p, static_cast<size_t>(basis) * stride + term);
    }
  }
}

struct PlaneSize {
  int width, height;
};
PlaneSize VectorSize(const btf::BtfHeader& header, const LinearShape& shape) {
  return {header.light_count(), shape.per_view ? 1 : header.view_count()};
}

}  // namespace

std::vector<std::string> TermChannels(int terms) {
  std::vector<std::string> channels;
  for (int k = 0; k < terms; ++k) channels.push_back(fmt::format("t{:04}", k));
  return channels;
}

StatusOr<int> CountTerms(const btf::CodedBtf& file, const std::string& name) {
  const auto weights = file.planes.find(name);
  if (weights == file.planes.end()) return InvalidArgument("part {} is missing", name);
  if (weights->second.channels.size() > static_cast<size_t>(kMaxTerms)) {
    return InvalidArgument("part {} has {} terms, at most {} are permitted", name,
                           weights->second.channels.size(), kMaxTerms);
  }
  return static_cast<int>(weights->second.channels.size());
}

btf::Plane WeightPlane(std::string name, const btf::BtfHeader& header, const LinearFactors& factors,
                       int family) {
  const size_t texels = header.texel_count(), stride = static_cast<size_t>(factors.shape.stride());
  const auto terms = static_cast<size_t>(factors.shape.terms);
  const float* const g = factors.g.data() + static_cast<size_t>(family) * texels * stride;
  std::vector<float> values(texels * terms);
  for (size_t k = 0; k < terms; ++k) {
    for (size_t i = 0; i < texels; ++i) values[k * texels + i] = g[i * stride + k];
  }
  return QuantisedPlane(std::move(name), header.width, header.height,
                        TermChannels(factors.shape.terms), factors.quantisation,
                        std::move(values));
}

Status TakeWeights(btf::CodedBtf& file, const std::string& name, LinearFactors& factors) {
  const btf::BtfHeader& header = file.info.header;
  const LinearShape& shape = factors.shape;
  const size_t texels = header.texel_count(), stride = static_cast<size_t>(shape.stride());
  const auto terms = static_cast<size_t>(shape.terms);
  MESORIG_ASSIGN_OR_RETURN(btf::Plane plane, TakePlane(file, name, header.width, header.height,
                                                       TermChannels(shape.terms)));
  MESORIG_ASSIGN_OR_RETURN(const std::vector<float> values,
                           Dequantised(std::move(plane), factors.quantisation));
  const size_t first = factors.g.size();
  factors.g.resize(first + texels * stride);  // only now: the plane proves the size
  for (size_t k = 0; k < terms; ++k) {
    for (size_t i = 0; i < texels; ++i) factors.g[first + i * stride + k] = values[k * texels + i];
  }
  for (size_t i = 0; shape.mean && i < texels; ++i) factors.g[first + i * stride + terms] = 1;
  return OkStatus();
}

btf::Plane ScalePlane(int width, int height, std::vector<float> scales) {
  return {"S", width, height, {"s"}, false, std::move(scales)};
}

StatusOr<std::vector<float>> TakeScales(btf::CodedBtf& file, int width, int height) {
  MESORIG_ASSIGN_OR_RETURN(btf::Plane plane, TakePlane(file, "S", width, height, {"s"}));
  for (const float scale : plane.values) {
    if (!(scale >= 0x1p-100f && scale <= 0x1p100f)) {
      return InvalidArgument("part S holds a scale of {}, permitted are 2^-100 to 2^100", scale);
    }
  }
  return std::move(plane.values);
}

btf::Plane FloorPlane(float floor) { return {"P", 1, 1, {"floor"}, false, {floor}}; }

StatusOr<float> TakeFloor(btf::CodedBtf& file) {
  MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane, TakePlane(file, "P", 1, 1, {"floor"}));
  const float floor = plane.values[0];
  if (floor >= 0 && floor <= 1e30f) return floor;
  return InvalidArgument("part P: a floor of {}, permitted are 0 (linear) to 1e30", floor);
}

Status CheckNothingLeft(const btf::CodedBtf& file) {
  if (file.planes.empty()) return OkStatus();
  return InvalidArgument("part {} belongs to no factor", file.planes.begin()->first);
}

std::vector<btf::Plane> LinearBtf::Planes() const {
  const btf::BtfHeader& header = info_.header;
  const LinearShape& shape = factors_.shape;
  std::vector<btf::Plane> planes;
  planes.push_back(FloorPlane(factors_.log_floor));
  planes.push_back(ScalePlane(shape.stride(), shape.bases(header), factors_.scales));
  if (!factors_.cluster.empty()) {
    planes.push_back({"K", header.width, header.height, {"k"}, true,
                      std::vector<float>(factors_.cluster.begin(), factors_.cluster.end())});
  }
  for (int f = 0; f < shape.families(header); ++f) {
    planes.push_back(WeightPlane(Numbered('G', f), header, factors_, f));
  }
  const PlaneSize size = VectorSize(header, shape);
  const std::vector<std::string> channels = VectorChannels(shape);
  for (int b = 0; b < shape.bases(header); ++b) {
    std::vector<float> values(channels.size() * shape.pairs(header));
    ForVectors(header, shape, b, [&](size_t memory, size_t plane, size_t scale) {
      values[plane] = factors_.h[memory] / factors_.scales[scale];
    });
    planes.push_back(QuantisedPlane(Numbered('H', b), size.width, size.height, channels,
                                    factors_.quantisation, std::move(values)));
  }
  return planes;
}

namespace {

Status ReadVectors(btf::CodedBtf& file, LinearFactors& factors) {
  const btf::BtfHeader& header = file.info.header;
  const LinearShape& shape = factors.shape;
  const PlaneSize size = VectorSize(header, shape);
  const std::vector<std::string> channels = VectorChannels(shape);
  for (int b = 0; b < shape.bases(header); ++b) {
    MESORIG_ASSIGN_OR_RETURN(btf::Plane plane, TakePlane(file, Numbered('H', b), size.width,
                                                         size.height, channels));
    Quantisation quantisation = Quantisation::kHalf;
    MESORIG_ASSIGN_OR_RETURN(const std::vector<float> values,
                             Dequantised(std::move(plane), quantisation));
    factors.h.resize(factors.h.size() + shape.pairs(header) * 3 * static_cast<size_t>(shape.stride()));
    ForVectors(header, shape, b, [&](size_t memory, size_t p, size_t scale) {
      factors.h[memory] = values[p] * factors.scales[scale];
    });
  }
  return OkStatus();
}

Status ReadClusters(btf::CodedBtf& file, LinearFactors& factors) {
  const btf::BtfHeader& header = file.info.header;
  MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane,
                           TakePlane(file, "K", header.width, header.height, {"k"}));
  for (size_t i = 0; i < plane.values.size(); ++i) {
    const float k = plane.values[i];
    if (!(k >= 0 && k < static_cast<float>(factors.shape.clusters)) || k != std::floor(k)) {
      return InvalidArgument("part K, texel {}: cluster {} of {}", i, k, factors.shape.clusters);
    }
    factors.cluster.push_back(static_cast<uint16_t>(k));
  }
  return OkStatus();
}

// The numbers of terms and clusters that the parts show.
StatusOr<LinearShape> ShapeOf(const btf::CodedBtf& file, bool per_view, bool clustered) {
  LinearShape shape;
  shape.per_view = per_view;
  shape.mean = clustered;
  MESORIG_ASSIGN_OR_RETURN(shape.terms, CountTerms(file, Numbered('G', 0)));
  if (!clustered) return shape;
  shape.clusters = 0;
  while (shape.clusters <= kMaxClusters && file.planes.contains(Numbered('H', shape.clusters))) {
    ++shape.clusters;
  }
  if (shape.clusters < 1 || shape.clusters > kMaxClusters) {
    return InvalidArgument("{} clusters, permitted are 1 to {}", shape.clusters, kMaxClusters);
  }
  return shape;
}

}  // namespace

StatusOr<std::unique_ptr<EncodedBtf>> DecodeLinear(btf::CodedBtf file, bool per_view, bool clustered,
                                                   bool decorrelated) {
  LinearFactors factors;
  MESORIG_ASSIGN_OR_RETURN(factors.shape, ShapeOf(file, per_view, clustered));
  MESORIG_ASSIGN_OR_RETURN(factors.log_floor, TakeFloor(file));
  factors.decorrelated = decorrelated;
  if (decorrelated && factors.log_floor <= 0) {
    return InvalidArgument("part P: a floor of {}, above 0 is permitted", factors.log_floor);
  }
  MESORIG_ASSIGN_OR_RETURN(factors.scales,
                           TakeScales(file, factors.shape.stride(),
                                      factors.shape.bases(file.info.header)));
  if (clustered) MESORIG_RETURN_IF_ERROR(ReadClusters(file, factors));
  for (int f = 0; f < factors.shape.families(file.info.header); ++f) {
    MESORIG_RETURN_IF_ERROR(TakeWeights(file, Numbered('G', f), factors));
  }
  MESORIG_RETURN_IF_ERROR(ReadVectors(file, factors));
  MESORIG_RETURN_IF_ERROR(CheckNothingLeft(file));
  return LinearBtf::Create(std::move(file.info), std::move(factors));
}

}  // namespace mesorig::codecs
