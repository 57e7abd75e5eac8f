#include "processing/mesostructure/merge.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "protocol/base/check.h"

namespace mesorig::mesostructure {
namespace {

constexpr int kRelaxations = 100;

struct Vote {
  float distance = 0, weight = 0;
};

// Votes are sorted by distance. Returns the first of the winning group; the nearer of two equals.
size_t Winner(const std::vector<Vote>& votes, float agreement, size_t& end) {
  size_t best = 0;
  double most = -1;
  for (size_t first = 0; first < votes.size(); ++first) {
    double support = 0;
    size_t last = first;
    while (last < votes.size() && votes[last].distance - votes[first].distance <= agreement) {
      support += std::sqrt(static_cast<double>(votes[last++].weight));
    }
    if (support > most) most = support, best = first, end = last;
  }
  return best;
}

// A level of the pyramid: mean of what is known, and whether anything is.
struct Level {
  int width = 0, height = 0;
  std::vector<float> value;
  std::vector<uint8_t> known;
  size_t At(int i, int j) const {
    return static_cast<size_t>(std::clamp(j, 0, height - 1)) * static_cast<size_t>(width) +
           static_cast<size_t>(std::clamp(i, 0, width - 1));
  }
};

Level Half(const Level& fine) {
  Level half{(fine.width + 1) / 2, (fine.height + 1) / 2, {}, {}};
  const size_t size = static_cast<size_t>(half.width) * static_cast<size_t>(half.height);
  std::vector<double> sum(size), count(size);
  for (int j = 0; j < fine.height; ++j) {
    for (int i = 0; i < fine.width; ++i) {
      const size_t from = fine.At(i, j), to = half.At(i / 2, j / 2);
      if (fine.known[from] != 0) sum[to] += static_cast<double>(fine.value[from]), count[to] += 1;
    }
  }
  for (size_t k = 0; k < size; ++k) {
    half.value.push_back(count[k] > 0 ? static_cast<float>(sum[k] / count[k]) : 0.0f);
    half.known.push_back(count[k] > 0 ? 1 : 0);
  }
  return half;
}

// Bilinear lookup at the place of fine texel (i, j).
float Lookup(const Level& half, int i, int j) {
  const int i0 = (i + 1) / 2 - 1, j0 = (j + 1) / 2 - 1;
  const float s = i % 2 == 0 ? 0.75f : 0.25f, t = j % 2 == 0 ? 0.75f : 0.25f;
  const auto row = [&](int y) {
    return (1 - s) * half.value[half.At(i0, y)] + s * half.value[half.At(i0 + 1, y)];
  };
  return (1 - t) * row(j0) + t * row(j0 + 1);
}

void Relax(Level& level, const std::vector<uint8_t>& measured) {
  for (int round = 0; round < kRelaxations; ++round) {
    for (int j = 0; j < level.height; ++j) {
      for (int i = 0; i < level.width; ++i) {
        const size_t at = level.At(i, j);
        if (measured[at] != 0) continue;
        level.value[at] =
            0.25f * (level.value[level.At(i - 1, j)] + level.value[level.At(i + 1, j)] +
                     level.value[level.At(i, j - 1)] + level.value[level.At(i, j + 1)]);
      }
    }
  }
}

}  // namespace

double AgreementMm(double pitch_mm) { return 0.5 * pitch_mm; }

void MergeImages(std::span<const btf::Mdf> images, std::span<float> distance,
                 std::span<float> confidence) {
  std::vector<Vote> votes;
  for (size_t k = 0; k < distance.size(); ++k) {
    votes.clear();
    double all = 0;
    for (const btf::Mdf& image : images) {
      const Vote vote{image.Distance(0)[k], image.Confidence(0)[k]};
      if (vote.weight > 0) votes.push_back(vote), all += static_cast<double>(vote.weight);
    }
    distance[k] = confidence[k] = 0;
    if (votes.empty()) continue;
    std::sort(votes.begin(), votes.end(),
              [](const Vote& a, const Vote& b) { return a.distance < b.distance; });
    size_t end = 0;
    const auto agreement = static_cast<float>(AgreementMm(images[0].header().pitch_mm));
    const size_t first = Winner(votes, agreement, end);
    double sum = 0, weight = 0;
    for (size_t i = first; i < end; ++i) {
      sum += static_cast<double>(votes[i].weight) * static_cast<double>(votes[i].distance);
      weight += static_cast<double>(votes[i].weight);
    }
    distance[k] = static_cast<float>(sum / weight);
    confidence[k] = static_cast<float>(weight * weight / all);
  }
}

bool FillHoles(int width, int height, std::span<float> distance,
               std::span<const float> confidence) {
  MESORIG_CHECK(distance.size() == static_cast<size_t>(width) * static_cast<size_t>(height));
  Level bottom{width, height, {distance.begin(), distance.end()}, {}};
  for (const float c : confidence) bottom.known.push_back(c > 0 ? 1 : 0);
  const std::vector<uint8_t> measured = bottom.known;
  std::vector<Level> levels = {std::move(bottom)};
  while (levels.back().width > 1 || levels.back().height > 1) levels.push_back(Half(levels.back()));
  if (levels.back().known[0] == 0) return false;
  for (size_t l = levels.size() - 1; l-- > 0;) {
    Level& fine = levels[l];
    for (int j = 0; j < fine.height; ++j) {
      for (int i = 0; i < fine.width; ++i) {
        const size_t at = fine.At(i, j);
        if (fine.known[at] == 0) fine.value[at] = Lookup(levels[l + 1], i, j);
      }
    }
  }
  Relax(levels[0], measured);
  std::copy(levels[0].value.begin(), levels[0].value.end(), distance.begin());
  return true;
}

}  // namespace mesorig::mesostructure
