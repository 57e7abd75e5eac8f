#include "protocol/wire/grpc_alive.h"

#include <grpc/grpc.h>
#include <grpc/support/log.h>

#include <cstdlib>

namespace mesorig::wire {

void KeepGrpcAlive() {
  [[maybe_unused]] static const bool kept = [] {
    // gRPC 1.51 has no option for it. These are the suites of TLS 1.2, and of one that takes a key
    // agreed on beforehand, which nobody has; those of TLS 1.3 are always there.
    ::setenv("GRPC_SSL_CIPHER_SUITES", "PSK-AES256-GCM-SHA384", 1);
    // A client tells its errors itself. (Services take them into their log: PrepareGrpc.)
    if (std::getenv("GRPC_VERBOSITY") == nullptr) gpr_set_log_function([](gpr_log_func_args*) {});
    grpc_init();  // never matched by a grpc_shutdown
    return true;
  }();
}

}  // namespace mesorig::wire
