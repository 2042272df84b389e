#include "catalog/digest.h"

#include <openssl/evp.h>

#include <array>
#include <memory>

#include "palpate/base/file.h"

namespace palpate {
namespace {

using Context = std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)>;

std::string hex(const unsigned char* bytes, unsigned size) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (unsigned i = 0; i < size; ++i) {
    text += kDigits[bytes[i] >> 4];
    text += kDigits[bytes[i] & 15];
  }
  return text;
}

Result<std::string> digest_of_file(const std::filesystem::path& file, const EVP_MD* algorithm,
                                   const std::string& prefix) {
  auto opened = InputFile::open(file);
  if (!opened) return opened.error();

  const Context context(EVP_MD_CTX_new(), &EVP_MD_CTX_free);
  bool good = context && EVP_DigestInit_ex(context.get(), algorithm, nullptr) == 1 &&
              EVP_DigestUpdate(context.get(), prefix.data(), prefix.size()) == 1;
  std::array<std::byte, 1 << 16> buffer;
  while (good) {
    const auto received = opened->read(buffer);
    if (!received) return received.error();
    if (*received == 0) break;
    good = EVP_DigestUpdate(context.get(), buffer.data(), *received) == 1;
  }

  std::array<unsigned char, EVP_MAX_MD_SIZE> digest;
  unsigned size = 0;
  if (!good || EVP_DigestFinal_ex(context.get(), digest.data(), &size) != 1)
    return Error{ErrorKind::kUnavailable, "OpenSSL cannot compute a digest", file.string(),
                 "this system's OpenSSL may forbid the algorithm"};
  return hex(digest.data(), size);
}

}  // namespace

Result<std::string> sha256_of_file(const std::filesystem::path& file) {
  return digest_of_file(file, EVP_sha256(), "");
}

Result<std::string> git_blob_of_file(const std::filesystem::path& file) {
  std::error_code failed;
  const auto size = std::filesystem::file_size(file, failed);
  if (failed) return Error{ErrorKind::kBadInput, "cannot be read", file.string(), "check its permissions"};
  return digest_of_file(file, EVP_sha1(), "blob " + std::to_string(size) + std::string(1, '\0'));
}

}  // namespace palpate
