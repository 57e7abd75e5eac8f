#pragma once
// The encoding half of all compression methods.

#include <memory>
#include <string_view>
#include <vector>

#include "processing/codecs/codec.h"
#include "processing/codecs/linear/quantisation.h"

namespace mesorig::codecs {

class SampleSource;  // linear/sample_source.h

inline constexpr int kAllTerms = -1;

// What the error that a factorisation makes smallest is measured in (linear/README.md).
enum class Weighting { kLinear, kLog, kRelative };
std::string_view NameOf(Weighting weighting);

struct EncodeOptions {
  int terms = 0;              // 0: the codec's default; kAllTerms: as many as there can be
  double regularisation = -1;  // < 0: the codec's default
  int clusters = 0;           // 0: the codec's default
  Weighting weighting = Weighting::kLinear;
  double floor = 0;           // of log and relative, in the BTF's unit; 0: a hundredth of the RMS
  bool solid_angle = false;   // pairs weigh by the solid angle of their directions
  bool variance = false;      // samples weigh by the BTF's variances (linear/sample_weights.h)
  bool clamp_negative = false;  // EncodeBtf: decoders show what is below zero as zero (clamped.h)
  std::optional<Quantisation> quantisation;  // nothing: half; float for kAllTerms
  int64_t block_bytes = int64_t{64} << 20;   // working memory of a factorisation, about
};

// The options that not every codec has; those of EncodeOptions before them are each codec's matter.
enum OptionSet : unsigned {
  kNoOptions = 0,
  kClusters = 1,
  kWeighting = 2,      // linear and relative, solid angle, variance
  kLogWeighting = 4,
  kQuantisation = 8,
};

class Encoder {
 public:
  virtual ~Encoder() = default;
  virtual std::string_view name() const = 0;
  // What of EncodeOptions it takes beside terms and regularisation.
  virtual unsigned options() const { return kNoOptions; }
  // The largest number of terms for this BTF; 0 for a codec without terms.
  virtual int max_terms(const btf::SampledBtf&) const { return 0; }
  // InvalidArgument for options out of range or that it does not have, a BTF without any present
  // pair, or one that holds values that are not finite. Reentrant.
  StatusOr<std::unique_ptr<EncodedBtf>> Encode(const btf::SampledBtf& btf,
                                               const EncodeOptions& options) const;
  // The same from a source that is never held whole: about 1 GB beside the factors at most, whatever
  // its size, and the same result but for rounding.
  virtual StatusOr<std::unique_ptr<EncodedBtf>> EncodeFrom(const SampleSource& source,
                                                           const EncodeOptions& options) const = 0;
};

// Encodes by a codec, and adds what is done alike for all: options.clamp_negative, which Encode of a
// codec by itself knows nothing of. Errors as Encoder::Encode. Reentrant.
StatusOr<std::unique_ptr<EncodedBtf>> EncodeBtf(const Encoder& encoder, const btf::SampledBtf& btf,
                                                const EncodeOptions& options);

StatusOr<std::unique_ptr<EncodedBtf>> EncodeBtf(const Encoder& encoder, const SampleSource& source,
                                                const EncodeOptions& options);

const std::vector<const Encoder*>& AllEncoders();
StatusOr<const Encoder*> FindEncoder(std::string_view name);

// What every EncodeFrom begins with: something is present, and nothing is asked for that `encoder` or
// `source` does not have. Values of files are checked when they are read.
Status CheckEncodable(const SampleSource& source, const EncodeOptions& options,
                      const Encoder& encoder);
// The file information of a BTF that codec `name` encodes; value_scale is 1.
btf::BtfFileInfo InfoOf(const SampleSource& source, std::string_view codec, int version);

}  // namespace mesorig::codecs
