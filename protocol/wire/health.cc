#include "protocol/wire/health.h"

#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

namespace mesorig::wire {

void EnableHealth() { grpc::EnableDefaultHealthCheckService(true); }

void SetServing(grpc::Server& server, const std::string& service, bool serving) {
  auto* const health = server.GetHealthCheckService();
  if (health != nullptr) health->SetServingStatus(service, serving);
}

}  // namespace mesorig::wire
