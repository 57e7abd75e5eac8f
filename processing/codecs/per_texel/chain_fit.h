#pragma once
// Makes the tables of texels fit their values: descent on one table after the other. Texels do not know
// of each other, but share what depends on directions alone: eight are fitted at once, one in each lane
// of a vector.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "processing/codecs/per_texel/chain.h"

namespace mesorig::codecs::per_texel {

class ChainFitter {
 public:
  // `present`: as in BtfFileInfo. Memory: 80 bytes a present pair, and 300 while it fits.
  ChainFitter(const btf::BtfHeader& header, const std::vector<uint8_t>& present,
              std::vector<Stage> stages);
  ChainFitter(const ChainFitter& other);
  ChainFitter(ChainFitter&&) noexcept;
  ~ChainFitter();

  // Pair indices view * lights + light, of entries 3 i to 3 i + 2 of what follows.
  const std::vector<size_t>& pairs() const { return pairs_; }
  const Layout& layout() const { return layout_; }
  const std::vector<Stage>& stages() const { return stages_; }

  // Of each texel, lowers sum of weight * (y - product)^2 over the present pairs; never raises it but
  // for rounding. A table's step is Jensen's: every node gets num / den of what it is part of, exact for
  // tables over directions and a bound for grids. Only stages from `first_stage` on change. Nodes that
  // no pair reads stay.
  //   y: three numbers a present pair, texel after texel. `weights`: of all texels alike.
  //   texels: in the order of Layout, without scales, texel after texel: where it starts, and the result.
  void Refine(std::span<const float> y, std::span<const float> weights, int sweeps,
              size_t first_stage, std::span<float> texels);
  // What the tables of one texel say, three numbers a present pair.
  void Evaluate(std::span<const float> texel, std::span<float> y) const;

 private:
  struct Lanes;
  struct Work;  // of eight texels
  void RefineEight(std::span<const float> weights, int sweeps, size_t first_stage);
  void SumStage(size_t s);
  void StepP(size_t s, size_t k, std::span<const float> weights);
  void StepQ(size_t s, size_t k, std::span<const float> weights);

  std::vector<Stage> stages_;
  Layout layout_;
  std::vector<size_t> pairs_;
  std::vector<PairTaps> taps_;
  std::unique_ptr<Work> work_;
};

}  // namespace mesorig::codecs::per_texel
