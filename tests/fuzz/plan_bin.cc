// plan.bin: refused, or a plan that packs again to what unpacks to the same.

#include "protocol/plan/plan.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  static const Rig rig = LoadRig(fuzz::Source("rigs/demo.toml")).value();
  const auto plan = UnpackPlan(fuzz::View(data, size), rig);
  if (!plan.ok()) {
    MESORIG_CHECK(absl::IsInvalidArgument(plan.status()));
    return 0;
  }
  const std::string packed = PackPlan(*plan);
  const auto again = UnpackPlan(packed, rig);
  MESORIG_CHECK(again.ok() && PackPlan(*again) == packed);
  return 0;
}
