#pragma once
// Internal to protocol/wire: OpenSSL's objects as owned values, its errors as text.

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <memory>
#include <string>
#include <string_view>

namespace mesorig::wire {

template <auto free_function>
struct FreeWith {
  template <typename T>
  void operator()(T* object) const {
    free_function(object);
  }
};

using OwnedBio = std::unique_ptr<BIO, FreeWith<BIO_free_all>>;
using OwnedX509 = std::unique_ptr<X509, FreeWith<X509_free>>;
using OwnedKey = std::unique_ptr<EVP_PKEY, FreeWith<EVP_PKEY_free>>;
using OwnedMdContext = std::unique_ptr<EVP_MD_CTX, FreeWith<EVP_MD_CTX_free>>;
using OwnedNames = std::unique_ptr<GENERAL_NAMES, FreeWith<GENERAL_NAMES_free>>;

// The newest error of this thread's queue, which is emptied: a later call must not find it.
std::string OpenSslError();

OwnedX509 ParsePem(std::string_view pem);  // null: none there
OwnedX509 ParseDer(std::string_view der);  // null: none, or bytes after it
std::string ToDer(const X509& certificate);

}  // namespace mesorig::wire
