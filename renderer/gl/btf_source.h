#pragma once
// A BTF to render: uncompressed or in a codec's form. Immutable; reentrant.

#include <array>
#include <filesystem>
#include <memory>
#include <vector>

#include "processing/btf/pair_weights.h"
#include "processing/btf/sampled_btf.h"
#include "processing/codecs/codec.h"

namespace mesorig::renderer {

class BtfSource {
 public:
  // NotFound or InvalidArgument naming the file. InvalidArgument also for a BTF whose values do not
  // carry the cosine of the light.
  static StatusOr<BtfSource> Load(const std::filesystem::path& path);
  static StatusOr<BtfSource> FromSampled(btf::SampledBtf sampled);
  static StatusOr<BtfSource> FromEncoded(std::unique_ptr<codecs::EncodedBtf> encoded);

  const btf::BtfHeader& header() const;
  std::string_view codec() const;  // "raw" or the codec's name
  bool Present(int view, int light) const;
  const codecs::EncodedBtf* encoded() const { return encoded_.get(); }  // null: uncompressed
  const btf::PairInterpolator& interpolator() const { return interpolator_; }

  // The image of measured view and light, W*H*3 as SampledBtf::Image.
  std::vector<float> Image(int view, int light) const;
  // One texel at arbitrary directions: btf::PairInterpolator between the samples of an uncompressed
  // BTF, the codec's own Evaluate otherwise, before any clamping: shaders filter first.
  std::array<float, 3> Evaluate(int x, int y, Vec3 v, Vec3 l) const;
  // The Lambert reflectance (rho / pi, sr^-1) that fits the most frontal view best over its lights:
  // sum(value * cos) / sum(cos^2) a texel; W*H*3. FailedPrecondition when nothing is present.
  StatusOr<std::vector<float>> PlainTexture() const;

 private:
  BtfSource(std::unique_ptr<btf::SampledBtf> sampled, std::unique_ptr<codecs::EncodedBtf> encoded,
            btf::PairInterpolator interpolator)
      : sampled_(std::move(sampled)),
        encoded_(std::move(encoded)),
        interpolator_(std::move(interpolator)) {}
  static StatusOr<BtfSource> Make(std::unique_ptr<btf::SampledBtf> sampled,
                                  std::unique_ptr<codecs::EncodedBtf> encoded);
  std::unique_ptr<btf::SampledBtf> sampled_;  // one of the two is null
  std::unique_ptr<codecs::EncodedBtf> encoded_;
  btf::PairInterpolator interpolator_;
};

}  // namespace mesorig::renderer
