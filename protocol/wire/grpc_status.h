#pragma once
// absl::Status over the wire: the codes are the same numbers.

#include <grpcpp/support/status.h>

#include "protocol/base/status.h"

namespace mesorig::wire {

grpc::Status ToGrpc(const Status& status);
Status FromGrpc(const grpc::Status& status);

}  // namespace mesorig::wire
