// A plan file for the demo's rig: refused with a message, or a plan that survives packing.

#include "protocol/plan/plan.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const Rig rig = LoadRig(fuzz::Source("rigs/demo.toml")).value();
  const auto plan = CompilePlan(fuzz::View(data, size), "plan.toml", rig);
  if (!plan.ok()) {
    MESORIG_CHECK(absl::IsInvalidArgument(plan.status()));
    MESORIG_CHECK(Message(plan.status()).starts_with("plan.toml"));
    return 0;
  }
  const std::string packed = PackPlan(*plan);
  const auto again = UnpackPlan(packed, rig);
  MESORIG_CHECK(again.ok() && PackPlan(*again) == packed);
  return 0;
}
