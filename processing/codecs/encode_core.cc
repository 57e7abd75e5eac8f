#include <cmath>

#include "processing/codecs/clamped.h"
#include "processing/codecs/encoder.h"
#include "processing/codecs/linear/sample_source.h"

namespace mesorig::codecs {
namespace {

Status CheckFinite(const btf::SampledBtf& btf) {
  const btf::BtfHeader& h = btf.header();
  for (int v = 0; v < h.view_count(); ++v) {
    for (int l = 0; l < h.light_count(); ++l) {
      if (!btf.Present(v, l)) continue;
      const auto image = btf.Image(v, l);
      for (size_t i = 0; i < image.size(); ++i) {
        if (std::isfinite(image[i])) continue;
        const auto width = static_cast<size_t>(h.width);
        return InvalidArgument("view {}, light {}, texel ({}, {}), channel {} holds {}, which is not finite",
                               v, l, i / 3 % width, i / 3 / width, "RGB"[i % 3], image[i]);
      }
    }
  }
  return OkStatus();
}

}  // namespace

std::string_view NameOf(Weighting weighting) {
  switch (weighting) {
    case Weighting::kLinear:
      return "linear";
    case Weighting::kLog:
      return "log";
    case Weighting::kRelative:
      return "relative";
  }
  return "linear";
}

StatusOr<std::unique_ptr<EncodedBtf>> EncodeBtf(const Encoder& encoder, const btf::SampledBtf& btf,
                                                const EncodeOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(auto encoded, encoder.Encode(btf, options));
  if (options.clamp_negative) return Clamped(std::move(encoded));
  return encoded;
}

StatusOr<std::unique_ptr<EncodedBtf>> EncodeBtf(const Encoder& encoder, const SampleSource& source,
                                                const EncodeOptions& options) {
  MESORIG_ASSIGN_OR_RETURN(auto encoded, encoder.EncodeFrom(source, options));
  if (options.clamp_negative) return Clamped(std::move(encoded));
  return encoded;
}

namespace {

Status CheckOptions(const EncodeOptions& options, const Encoder& encoder) {
  const unsigned takes = encoder.options();
  const auto refuse = [&](std::string_view option) {
    return InvalidArgument("codec {} has no {}", encoder.name(), option);
  };
  if (options.clusters != 0 && (takes & kClusters) == 0) return refuse("clusters");
  if (options.weighting == Weighting::kLog && (takes & kLogWeighting) == 0) {
    return refuse("log weighting");
  }
  if (options.weighting == Weighting::kRelative && (takes & kWeighting) == 0) {
    return refuse("relative weighting");
  }
  if (options.solid_angle && (takes & kWeighting) == 0) return refuse("solid-angle weights");
  if (options.variance && (takes & kWeighting) == 0) return refuse("weights from variances");
  if (options.quantisation && (takes & kQuantisation) == 0) return refuse("choice of quantisation");
  if (!(options.floor >= 0 && options.floor <= 1e30)) {
    return InvalidArgument("floor {}, permitted are 0 to 1e30", options.floor);
  }
  return OkStatus();
}

}  // namespace

Status CheckEncodable(const SampleSource& source, const EncodeOptions& options,
                      const Encoder& encoder) {
  MESORIG_RETURN_IF_ERROR(CheckOptions(options, encoder));
  if (options.variance && !source.has_variance()) {
    return InvalidArgument("weights from variances: the BTF has none (channels L000.V...)");
  }
  if (source.Pairs().empty()) return InvalidArgument("no (view, light) pair is present");
  return OkStatus();
}

StatusOr<std::unique_ptr<EncodedBtf>> Encoder::Encode(const btf::SampledBtf& btf,
                                                      const EncodeOptions& options) const {
  const MemorySource source(btf);
  MESORIG_RETURN_IF_ERROR(CheckEncodable(source, options, *this));
  MESORIG_RETURN_IF_ERROR(CheckFinite(btf));
  return EncodeFrom(source, options);
}

btf::BtfFileInfo InfoOf(const SampleSource& source, std::string_view codec, int version) {
  btf::BtfFileInfo info;
  info.header = source.header();
  info.codec = codec;
  info.codec_version = version;
  info.codec_options_json = "{}";
  info.present = source.present();
  return info;
}

}  // namespace mesorig::codecs
