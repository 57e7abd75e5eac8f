#include "protocol/wire/grpc_alive.h"

#include <grpc/grpc.h>

namespace mesorig::wire {

void KeepGrpcAlive() {
  [[maybe_unused]] static const bool kept = [] {
    grpc_init();  // never matched by a grpc_shutdown
    return true;
  }();
}

}  // namespace mesorig::wire
