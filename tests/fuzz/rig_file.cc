// A rig file: refused with a message, or a rig.

#include "protocol/rig/rig.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  const auto rig = ParseRig(fuzz::View(data, size), "rig.toml");
  if (rig.ok()) {
    MESORIG_CHECK(ParseRig(rig->source_text, "rig.toml")->sha256 == rig->sha256);
  } else {
    MESORIG_CHECK(absl::IsInvalidArgument(rig.status()));
    MESORIG_CHECK(Message(rig.status()).starts_with("rig.toml"));
  }
  return 0;
}
