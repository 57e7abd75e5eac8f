#include "protocol/wire/frame_codec.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <array>

namespace mesorig::wire {

grpc::ByteBuffer EncodeFrame(const v1::FrameHeader& header, std::string_view pixels,
                             std::shared_ptr<const void> owner) {
  namespace io = google::protobuf::io;
  // Field 1 (header) and field 2 (pixels), both length-delimited: tags 0x0A and 0x12.
  std::string prefix;
  {
    io::StringOutputStream stream(&prefix);
    io::CodedOutputStream out(&stream);
    out.WriteTag(v1::Frame::kHeaderFieldNumber << 3 | 2);
    out.WriteVarint64(header.ByteSizeLong());
    header.SerializeToCodedStream(&out);
    out.WriteTag(v1::Frame::kPixelsFieldNumber << 3 | 2);
    out.WriteVarint64(pixels.size());
  }
  auto* keep = new std::shared_ptr<const void>(std::move(owner));  // freed with the slice
  const std::array<grpc::Slice, 2> slices = {
      grpc::Slice(prefix),
      grpc::Slice(
          const_cast<char*>(pixels.data()), pixels.size(),
          [](void* user) { delete static_cast<std::shared_ptr<const void>*>(user); }, keep)};
  return {slices.data(), slices.size()};
}

}  // namespace mesorig::wire
