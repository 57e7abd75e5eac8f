// What peers say they are: a token, a certificate in PEM or DER, a list of allowed certificates.
// The first byte of the input chooses: 't', 'p', 'd', 'a'; the rest is it.

#include "daemon/service/allow_list.h"
#include "protocol/wire/identity.h"
#include "protocol/wire/token.h"
#include "tests/fuzz/fuzz_target.h"

namespace mesorig {
namespace {

void CheckIdentity(const StatusOr<wire::Identity>& identity) {
  if (!identity.ok()) {
    MESORIG_CHECK(absl::IsInvalidArgument(identity.status()));
    return;
  }
  MESORIG_CHECK(wire::ValidName(identity->name) && wire::ValidName(identity->role));
  MESORIG_CHECK(identity->fingerprint.size() == 64);
}

void CheckToken(std::string_view text) {
  const auto token = wire::ParseToken(text);
  if (token.ok()) CheckIdentity(token->user);
  // No key signs for this CA, which is none.
  const auto verified = wire::TokenVerifier("").Verify(text, 1'800'000'000);
  MESORIG_CHECK(!verified.ok() && absl::IsUnauthenticated(verified.status()));
}

}  // namespace
}  // namespace mesorig

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace mesorig;
  std::string_view text = fuzz::View(data, size);
  if (text.empty()) return 0;
  const char kind = text[0];
  text.remove_prefix(1);
  switch (kind) {
    case 't':
      CheckToken(text);
      break;
    case 'p':
      CheckIdentity(wire::ReadIdentityPem(text));
      break;
    case 'd':
      CheckIdentity(wire::ReadIdentityDer(text));
      break;
    default:
      for (const std::string& fingerprint : daemon::ReadAllowed(text)) {
        MESORIG_CHECK(fingerprint.size() == 64);
      }
  }
  return 0;
}
