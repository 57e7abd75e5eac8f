#pragma once
// Makes the tables of one texel fit its values: descent on one table after the other.

#include <memory>
#include <span>
#include <vector>

#include "processing/codecs/per_texel/chain.h"

namespace mesorig::codecs::per_texel {

class ChainFitter {
 public:
  // `present`: as in BtfFileInfo. Memory: 80 bytes a present pair.
  ChainFitter(const btf::BtfHeader& header, const std::vector<uint8_t>& present,
              std::vector<Stage> stages);

  // Pair indices view * lights + light, of entries 3 i to 3 i + 2 of what follows.
  const std::vector<size_t>& pairs() const { return pairs_; }
  const Layout& layout() const { return layout_; }
  const std::vector<Stage>& stages() const { return stages_; }

  // Lowers sum of weight * (y - product)^2 over the present pairs; never raises it but for rounding.
  // A table's step is Jensen's: every node gets num / den of what it is part of, exact for tables over
  // directions and a bound for grids. `texel`: in the order of Layout, without scales, is where it
  // starts. Only stages from `first_stage` on change. Nodes that no pair reads stay.
  void Refine(std::span<const float> y, std::span<const float> weights, int sweeps,
              size_t first_stage, std::span<float> texel);
  // What the tables say, three numbers a present pair.
  void Evaluate(std::span<const float> texel, std::span<float> y) const;

 private:
  void RefineStage(size_t s, std::span<const float> y, std::span<const float> weights,
                   std::span<float> texel);
  void StepP(size_t s, size_t k, std::span<const float> weights, std::span<float> texel);
  void StepQ(size_t s, size_t k, std::span<const float> weights, std::span<float> texel);

  std::vector<Stage> stages_;
  Layout layout_;
  std::vector<size_t> pairs_;
  std::vector<PairTaps> taps_;
  std::vector<float> others_, rest_;  // of the other stages, and what is not explained yet
  std::vector<float> pq_;             // one term's P, Q at each pair: p, r, g, b
  std::vector<double> num_, den_;
};

}  // namespace mesorig::codecs::per_texel
