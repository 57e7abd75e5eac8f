#pragma once
// A Frame message without copying its pixels: header and the pixels' length prefix are one slice,
// the pixels another that shares ownership of the caller's memory. Any gRPC client reads it as an
// ordinary mesorig.v1.Frame.

#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <string_view>

#include "protocol/messages/frames.pb.h"

namespace mesorig::wire {

// `owner` keeps `pixels` alive until the bytes are sent.
grpc::ByteBuffer EncodeFrame(const v1::FrameHeader& header, std::string_view pixels,
                             std::shared_ptr<const void> owner);

}  // namespace mesorig::wire
