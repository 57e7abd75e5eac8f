#pragma once
// Internal to protocol/wire.

namespace mesorig::wire {

// Keeps gRPC's library initialised until the process ends. Without it the last channel or server
// to go joins gRPC's background poller, which sleeps up to 10 s: every client would end that late.
// And TLS 1.3 only. The first call sets an environment variable: before threads that look at it.
void KeepGrpcAlive();

}  // namespace mesorig::wire
