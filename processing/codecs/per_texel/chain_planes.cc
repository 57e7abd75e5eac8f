// Tables as planes of a file, and back (README.md has their names).

#include <algorithm>
#include <cmath>

#include "processing/codecs/linear/linear_planes.h"
#include "processing/codecs/per_texel/chain_btf.h"

namespace mesorig::codecs::per_texel {
namespace {

constexpr int kMaxTerms = 4096;
constexpr float kLeastScale = 0x1p-60f, kMostScale = 0x1p60f;
constexpr double kLargestProduct = 0x1p62;  // its square stays in float: mip levels are fitted

// One table of the model: `channels` in the order of its numbers in memory, but for colours.
struct Table {
  std::string name;
  size_t first, terms, nodes, colours;  // 1 or 3 colours
};

std::vector<Table> TablesOf(const std::vector<Stage>& stages, const Layout& layout) {
  std::vector<Table> tables;
  for (size_t s = 0; s < stages.size(); ++s) {
    const Layout::Tables& t = layout.stages[s];
    const auto terms = static_cast<size_t>(stages[s].terms);
    if (t.p_nodes > 0) tables.push_back({fmt::format("P{}", s), t.p_first, terms, t.p_nodes, 1});
    tables.push_back({fmt::format("Q{}", s), t.q_first, terms, t.q_nodes, 3});
  }
  return tables;
}

// Sorted by name, as planes are when read: blue before green before red.
std::vector<std::string> ChannelsOf(const Table& table) {
  std::vector<std::string> channels;
  for (size_t k = 0; k < table.terms; ++k) {
    for (size_t node = 0; node < table.nodes; ++node) {
      const std::string name = fmt::format("t{:04}.n{:05}", k, node);
      if (table.colours == 1) {
        channels.push_back(name);
      } else {
        for (const char* rgb : {".B", ".G", ".R"}) channels.push_back(name + rgb);
      }
    }
  }
  return channels;
}

// Where the channel stands among a texel's numbers.
size_t PlaceOf(const Table& table, size_t channel) {
  if (table.colours == 1) return table.first + channel;
  return table.first + channel / 3 * 3 + 2 - channel % 3;
}

// "s0", "s1": a channel a stage.
std::vector<std::string> StageChannels(size_t stages) {
  std::vector<std::string> channels;
  for (size_t s = 0; s < stages; ++s) channels.push_back(fmt::format("s{}", s));
  return channels;
}

}  // namespace

std::vector<btf::Plane> ChainBtf::Planes() const {
  const btf::BtfHeader& h = info_.header;
  const size_t texels = h.texel_count(), stages = factors_.stages.size();
  std::vector<btf::Plane> planes = {FloorPlane(factors_.floor)};
  btf::Plane scales{"S", h.width, h.height, StageChannels(stages), false, {}};
  for (size_t s = 0; s < stages; ++s) {
    for (size_t i = 0; i < texels; ++i) scales.values.push_back(factors_.scales[i * stages + s]);
  }
  planes.push_back(std::move(scales));
  size_t width = static_cast<size_t>(h.width), height = static_cast<size_t>(h.height);
  if (!factors_.clusters.empty()) {
    btf::Plane clusters{"K", h.width, h.height, StageChannels(stages), true, {}};
    for (size_t s = 0; s < stages; ++s) {
      for (size_t i = 0; i < texels; ++i) clusters.values.push_back(factors_.clusters[i * stages + s]);
    }
    planes.push_back(std::move(clusters));
    width = factors_.values.size() / layout_.size, height = 1;
  }
  for (const Table& table : TablesOf(factors_.stages, layout_)) {
    std::vector<std::string> channels = ChannelsOf(table);
    std::vector<float> values;
    values.reserve(channels.size() * width * height);
    for (size_t channel = 0; channel < channels.size(); ++channel) {
      const size_t place = PlaceOf(table, channel);
      for (size_t i = 0; i < width * height; ++i) {
        values.push_back(factors_.values[i * layout_.size + place]);
      }
    }
    planes.push_back(QuantisedPlane(table.name, static_cast<int>(width), static_cast<int>(height),
                                    std::move(channels), factors_.quantisation, std::move(values)));
  }
  return planes;
}

namespace {

// The numbers of terms that the parts show.
Status CountTerms(const btf::CodedBtf& file, std::vector<Stage>& stages) {
  for (size_t s = 0; s < stages.size(); ++s) {
    const std::string name = fmt::format("Q{}", s);
    const auto at = file.planes.find(name);
    if (at == file.planes.end()) return InvalidArgument("part {} is missing", name);
    const size_t a_term = 3 * static_cast<size_t>(NodesOf(stages[s].q, file.info.header));
    const size_t channels = at->second.channels.size();
    if (channels == 0 || channels % a_term != 0 || channels / a_term > kMaxTerms) {
      return InvalidArgument("part {} has {} channels, a multiple of {} is expected, at most {} times",
                             name, channels, a_term, kMaxTerms);
    }
    stages[s].terms = static_cast<int>(channels / a_term);
  }
  return OkStatus();
}

StatusOr<std::vector<float>> ReadScales(btf::CodedBtf& file, size_t stages) {
  const btf::BtfHeader& h = file.info.header;
  MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane,
                           TakePlane(file, "S", h.width, h.height, StageChannels(stages)));
  const size_t texels = h.texel_count();
  std::vector<float> scales(plane.values.size());
  for (size_t i = 0; i < plane.values.size(); ++i) {
    const float scale = plane.values[i];
    if (!(scale >= kLeastScale && scale <= kMostScale)) {
      return InvalidArgument("part S, texel {}: a scale of {}, permitted are 2^-60 to 2^60",
                             i % texels, scale);
    }
    scales[i % texels * stages + i / texels] = scale;
  }
  return scales;
}

// The clusters of `rows` that texels read; nothing without a part K.
StatusOr<std::vector<uint16_t>> ReadClusters(btf::CodedBtf& file, size_t stages, int& rows) {
  std::vector<uint16_t> clusters;
  if (!file.planes.contains("K")) return clusters;
  const btf::BtfHeader& h = file.info.header;
  MESORIG_ASSIGN_OR_RETURN(const btf::Plane plane,
                           TakePlane(file, "K", h.width, h.height, StageChannels(stages)));
  const auto q = file.planes.find("Q0");  // CountTerms has found it
  rows = q->second.width;
  if (rows < 1 || rows > static_cast<int>(kMaxClusters)) {
    return InvalidArgument("part Q0 has {} clusters, permitted are 1 to {}", rows, kMaxClusters);
  }
  const size_t texels = h.texel_count();
  clusters.resize(plane.values.size());
  for (size_t i = 0; i < plane.values.size(); ++i) {
    const float k = plane.values[i];
    if (!(k >= 0 && k < static_cast<float>(rows)) || k != std::floor(k)) {
      return InvalidArgument("part K, texel {}: cluster {} of {}", i % texels, k, rows);
    }
    clusters[i % texels * stages + i / texels] = static_cast<uint16_t>(k);
  }
  return clusters;
}

// Numbers of the tables are at most 1: so is a term, and a product what the scales and terms say.
Status CheckProducts(const std::vector<Stage>& stages, const std::vector<float>& scales) {
  for (size_t i = 0; i * stages.size() < scales.size(); ++i) {
    double largest = 1;
    for (size_t s = 0; s < stages.size(); ++s) {
      largest *= static_cast<double>(scales[i * stages.size() + s]) * stages[s].terms;
    }
    if (!(largest <= kLargestProduct)) {
      return InvalidArgument("part S, texel {}: products up to {:g}, at most {:g} are permitted", i,
                             largest, kLargestProduct);
    }
  }
  return OkStatus();
}

}  // namespace

StatusOr<std::unique_ptr<EncodedBtf>> DecodeChain(btf::CodedBtf file, std::vector<Stage> stages) {
  const btf::BtfHeader& h = file.info.header;
  ChainFactors factors;
  MESORIG_RETURN_IF_ERROR(CountTerms(file, stages));
  MESORIG_ASSIGN_OR_RETURN(factors.floor, TakeFloor(file));
  MESORIG_ASSIGN_OR_RETURN(factors.scales, ReadScales(file, stages.size()));
  MESORIG_RETURN_IF_ERROR(CheckProducts(stages, factors.scales));
  const Layout layout = LayoutOf(stages, h);
  int width = h.width, height = h.height;
  MESORIG_ASSIGN_OR_RETURN(factors.clusters, ReadClusters(file, stages.size(), width));
  if (!factors.clusters.empty()) height = 1;
  const size_t rows = static_cast<size_t>(width) * static_cast<size_t>(height);
  // Parts first, memory then: the planes prove the size.
  std::vector<std::pair<Table, std::vector<float>>> read;
  for (const Table& table : TablesOf(stages, layout)) {
    MESORIG_ASSIGN_OR_RETURN(btf::Plane plane, TakePlane(file, table.name, width, height,
                                                         ChannelsOf(table)));
    MESORIG_ASSIGN_OR_RETURN(std::vector<float> values,
                             Dequantised(std::move(plane), factors.quantisation));
    read.emplace_back(table, std::move(values));
  }
  MESORIG_RETURN_IF_ERROR(CheckNothingLeft(file));
  factors.values.resize(rows * layout.size);
  for (const auto& [table, values] : read) {
    for (size_t channel = 0; channel * rows < values.size(); ++channel) {
      const size_t place = PlaceOf(table, channel);
      for (size_t i = 0; i < rows; ++i) {
        factors.values[i * layout.size + place] = values[channel * rows + i];
      }
    }
  }
  factors.stages = std::move(stages);
  return ChainBtf::Create(std::move(file.info), std::move(factors));
}

}  // namespace mesorig::codecs::per_texel
