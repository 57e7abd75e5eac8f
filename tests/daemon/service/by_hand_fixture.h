#pragma once
// The service over a rig in memory that can be moved by hand.

#include "tests/daemon/fakes/fake_manual.h"
#include "tests/daemon/service/service_fixture.h"

namespace mesorig::daemon {

class ByHandTest : public ServiceTest {
 protected:
  ByHandTest() { manual_ = &hand_; }
  v1::LeaseStatus Take(bool take = false) {
    grpc::ClientContext context;
    v1::AcquireLeaseRequest request;
    request.set_take(take);
    v1::LeaseReply reply;
    const grpc::Status status = control_->AcquireLease(&context, request, &reply);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return reply.lease();
  }

  FakeManual hand_;
};

}  // namespace mesorig::daemon
