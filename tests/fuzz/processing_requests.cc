// Requests to the Processing service (requests.h). Its jobs are fakes: done at once, or failed when
// the session's id says so.

#include "processing/service/job_table.h"
#include "tests/fuzz/requests.h"

namespace mesorig::service {
namespace {

class FakeJob final : public Job {
 public:
  explicit FakeJob(std::string session_id) : session_id_(std::move(session_id)) {}
  void Stop() override {}
  v1::ProductsReply Snapshot() const override {
    v1::ProductsReply reply;
    reply.set_session_id(session_id_);
    reply.set_done(!failed());
    return reply;
  }
  bool finished() const override { return true; }
  bool failed() const override { return session_id_.starts_with("fails"); }
  uint32_t start() const override { return 1; }

 private:
  const std::string session_id_;
};

}  // namespace
}  // namespace mesorig::service

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const fuzz::ScratchFolder scratch;
  static auto* const table = new service::JobTable(
      scratch.path(), [](const std::string& session_id, std::function<void()>) {
        return std::make_shared<service::FakeJob>(session_id);
      },
      [](const std::string&) { return std::optional<uint32_t>(1); });
  static auto* const runner = new fuzz::RequestRunner({table});  // gRPC's threads outlive main
  runner->Run(fuzz::View(data, size));
  return 0;
}
