#include "protocol/wire/token.h"

#include <absl/strings/escaping.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/rand.h>

#include <algorithm>

#include "protocol/base/bytes.h"
#include "protocol/base/digest.h"
#include "protocol/wire/openssl_owned.h"

namespace mesorig::wire {
namespace {

constexpr std::string_view kMagic = "MTK1";
constexpr size_t kNonceBytes = 16, kMaxSignatureBytes = 1024;

using OwnedStore = std::unique_ptr<X509_STORE, FreeWith<X509_STORE_free>>;
using OwnedStoreContext = std::unique_ptr<X509_STORE_CTX, FreeWith<X509_STORE_CTX_free>>;

template <typename... Args>
Status Unauthenticated(fmt::format_string<Args...> format, Args&&... args) {
  return absl::UnauthenticatedError(fmt::format(format, std::forward<Args>(args)...));
}

bool IsFingerprint(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == text.npos;
}

Status CheckChain(X509& certificate, std::string_view ca_pem, int64_t now_s) {
  const OwnedX509 ca = ParsePem(ca_pem);
  if (ca == nullptr) return Unauthenticated("token: the daemon has no CA to verify it with");
  const OwnedStore store(X509_STORE_new());
  X509_STORE_add_cert(store.get(), ca.get());
  const OwnedStoreContext context(X509_STORE_CTX_new());
  if (X509_STORE_CTX_init(context.get(), store.get(), &certificate, nullptr) != 1) {
    return Unauthenticated("token: {}", OpenSslError());
  }
  X509_STORE_CTX_set_purpose(context.get(), X509_PURPOSE_SSL_CLIENT);
  X509_STORE_CTX_set_time(context.get(), 0, static_cast<time_t>(now_s));
  const bool valid = X509_verify_cert(context.get()) == 1;
  ERR_clear_error();
  if (valid) return OkStatus();
  return Unauthenticated("token: its certificate: {}",
                         X509_verify_cert_error_string(X509_STORE_CTX_get_error(context.get())));
}

bool SignatureHolds(X509& certificate, std::string_view bytes, std::string_view signature) {
  EVP_PKEY* key = X509_get0_pubkey(&certificate);
  const OwnedMdContext context(EVP_MD_CTX_new());
  const auto* raw = reinterpret_cast<const unsigned char*>(signature.data());
  const bool holds =
      key != nullptr &&
      EVP_DigestVerifyInit(context.get(), nullptr, EVP_sha256(), nullptr, key) == 1 &&
      EVP_DigestVerify(context.get(), raw, signature.size(),
                       reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()) == 1;
  ERR_clear_error();
  return holds;
}

StatusOr<std::string> Sign(EVP_PKEY& key, std::string_view bytes) {
  const OwnedMdContext context(EVP_MD_CTX_new());
  const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
  size_t size = 0;
  if (EVP_DigestSignInit(context.get(), nullptr, EVP_sha256(), nullptr, &key) != 1 ||
      EVP_DigestSign(context.get(), nullptr, &size, data, bytes.size()) != 1) {
    return InvalidArgument("token: the key cannot sign: {}", OpenSslError());
  }
  std::string signature(size, '\0');
  if (EVP_DigestSign(context.get(), reinterpret_cast<unsigned char*>(signature.data()), &size, data,
                     bytes.size()) != 1) {
    return InvalidArgument("token: the key cannot sign: {}", OpenSslError());
  }
  signature.resize(size);
  return signature;
}

}  // namespace

StatusOr<std::string> MakeToken(std::string_view key_pem, std::string_view certificate_pem,
                                std::string_view gateway_fingerprint, int64_t now_s,
                                int64_t life_s) {
  if (!IsFingerprint(gateway_fingerprint)) {
    return InvalidArgument("token: \"{}\" is not a certificate's SHA-256, 64 digits 0-9 a-f",
                           gateway_fingerprint);
  }
  if (life_s < 1 || life_s > kMaxTokenLife_s) {
    return InvalidArgument("token: {} s to live is not in [1, {}] s", life_s, kMaxTokenLife_s);
  }
  const OwnedX509 certificate = ParsePem(certificate_pem);
  const OwnedBio bio(BIO_new_mem_buf(key_pem.data(), static_cast<int>(key_pem.size())));
  const OwnedKey key(PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr));
  if (certificate == nullptr || key == nullptr ||
      X509_check_private_key(certificate.get(), key.get()) != 1) {
    return InvalidArgument("token: the key and the certificate do not belong together");
  }
  std::string nonce(kNonceBytes, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(nonce.data()), kNonceBytes) != 1) {
    return Internal("token: no random bytes: {}", OpenSslError());
  }
  ByteWriter out;
  out.PutRaw(kMagic).PutString(gateway_fingerprint).Put(now_s).Put(now_s + life_s).PutString(nonce);
  out.PutString(ToDer(*certificate));
  MESORIG_ASSIGN_OR_RETURN(const std::string signature, Sign(*key, out.bytes()));
  out.PutString(signature);
  std::string text;
  absl::Base64Escape({out.bytes().data(), out.bytes().size()}, &text);
  MESORIG_RETURN_IF_ERROR(ParseToken(text).status());
  return text;
}

StatusOr<Token> ParseToken(std::string_view text) {
  if (text.empty() || text.size() > kMaxTokenBytes) {
    return InvalidArgument("token: {} bytes, 1 to {} are read", text.size(), kMaxTokenBytes);
  }
  std::string bytes;
  if (!absl::Base64Unescape({text.data(), text.size()}, &bytes)) {
    return InvalidArgument("token: not in base64");
  }
  ByteReader in(bytes);
  Token token;
  const bool magic = in.GetRaw(kMagic.size()) == kMagic;
  token.gateway = in.GetString();
  token.issued_s = in.Get<int64_t>();
  token.expires_s = in.Get<int64_t>();
  token.nonce = in.GetString();
  token.certificate = in.GetString();
  token.signed_part = bytes.substr(0, bytes.size() - in.remaining());
  token.signature = in.GetString();
  if (!magic || !in.done() || !IsFingerprint(token.gateway) || token.nonce.size() != kNonceBytes ||
      token.signature.empty() || token.signature.size() > kMaxSignatureBytes) {
    return InvalidArgument("token: not one, or damaged");
  }
  MESORIG_ASSIGN_OR_RETURN(token.user, ReadIdentityDer(token.certificate));
  return token;
}

StatusOr<Token> TokenVerifier::Verify(std::string_view text, int64_t now_s) const {
  auto parsed = ParseToken(text);
  if (!parsed.ok()) return Unauthenticated("token refused: {}", Message(parsed.status()));
  Token& token = *parsed;
  // (Compared before it is subtracted: the numbers are anybody's.)
  if (token.expires_s <= now_s) return Unauthenticated("token: expired");
  if (token.issued_s > now_s + kClockSkew_s) return Unauthenticated("token: issued in the future");
  if (token.issued_s < now_s - kMaxTokenLife_s ||
      token.expires_s > token.issued_s + kMaxTokenLife_s) {
    return Unauthenticated("token: lasts longer than {} s", kMaxTokenLife_s);
  }
  const OwnedX509 certificate = ParseDer(token.certificate);
  if (!SignatureHolds(*certificate, token.signed_part, token.signature)) {
    return Unauthenticated("token: its signature is not the user's");
  }
  MESORIG_RETURN_IF_ERROR(CheckChain(*certificate, ca_pem_, now_s));
  return parsed;
}

const Token* TokenBook::Known(std::string_view text, std::string_view connection) const {
  const auto at = by_text_.find(Sha256(text));
  if (at == by_text_.end() || at->second->connection != connection) return nullptr;
  return &at->second->token;
}

StatusOr<const Token*> TokenBook::Enter(Token token, std::string_view text,
                                        std::string_view connection, int64_t now_s) {
  if (token.issued_s < opened_s_) {
    return Unauthenticated("token: issued before the daemon began; send a new one");
  }
  if (entries_.size() >= kMaxEntries) {
    for (auto at = entries_.begin(); at != entries_.end();) {
      if (at->second.token.expires_s > now_s) {
        ++at;
        continue;
      }
      by_text_.erase(at->second.text_sha256);
      at = entries_.erase(at);
    }
  }
  const std::string user = token.user.fingerprint;
  const auto of_user = std::count_if(entries_.begin(), entries_.end(), [&](const auto& entry) {
    return entry.second.token.user.fingerprint == user && entry.second.token.expires_s > now_s;
  });
  if (entries_.size() >= kMaxEntries || static_cast<size_t>(of_user) >= kMaxOfOneUser) {
    return Unauthenticated("token: {} of {} are in use, more are not kept", of_user,
                           token.user.name);
  }
  const auto [at, fresh] = entries_.try_emplace(user + token.nonce);
  if (!fresh) {
    return Unauthenticated("token: used before, over another connection; it serves one only");
  }
  at->second = {std::move(token), Sha256(text), std::string(connection)};
  by_text_[at->second.text_sha256] = &at->second;
  return &at->second.token;
}

}  // namespace mesorig::wire
