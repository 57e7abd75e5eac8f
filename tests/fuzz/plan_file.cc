// A plan file for the rigs that ship: refused with a message, or a plan that survives packing.

#include "protocol/plan/plan.h"
#include "tests/fuzz/fuzz_target.h"

namespace mesorig {
namespace {

void Compile(std::string_view text, const Rig& rig) {
  const auto plan = CompilePlan(text, "plan.toml", rig);
  if (!plan.ok()) {
    MESORIG_CHECK(absl::IsInvalidArgument(plan.status()));
    MESORIG_CHECK(Message(plan.status()).starts_with("plan.toml"));
    return;
  }
  const std::string packed = PackPlan(*plan);
  const auto again = UnpackPlan(packed, rig);
  MESORIG_CHECK(again.ok() && PackPlan(*again) == packed);
}

}  // namespace
}  // namespace mesorig

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const Rig demo = LoadRig(fuzz::Source("rigs/demo.toml")).value();
  static const Rig wang2005 = LoadRig(fuzz::Source("rigs/wang2005.toml")).value();
  Compile(fuzz::View(data, size), demo);
  Compile(fuzz::View(data, size), wang2005);
  return 0;
}
