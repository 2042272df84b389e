#include "palpate/cache/digest.h"

#include <openssl/evp.h>

#include <algorithm>
#include <atomic>
#include <memory>

#include "palpate/base/for_each_index.h"

namespace palpate::cache {
namespace {

bool sha256(std::span<const std::byte> bytes, Digest& digest) {
  return EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(digest.data()), nullptr,
                    EVP_sha256(), nullptr) == 1;
}

}  // namespace

std::optional<Digest> digest_of(std::span<const std::byte> bytes) {
  // digest of the size and the pieces' digests; the size distinguishes one piece from the digests of two
  constexpr std::size_t kPiece = std::size_t{1} << 22;
  const auto pieces = static_cast<int>((bytes.size() + kPiece - 1) / kPiece);
  std::vector<Digest> digests(static_cast<std::size_t>(pieces));
  const bool done = for_each_index(pieces, worker_count(0, pieces), [&](int /*worker*/, int index) {
    const auto piece = static_cast<std::size_t>(index);
    const std::size_t first = piece * kPiece;
    return sha256(bytes.subspan(first, std::min(kPiece, bytes.size() - first)), digests[piece]);
  });
  const std::uint64_t size = bytes.size();
  std::vector<std::byte> all(sizeof size + digests.size() * sizeof(Digest));
  const auto size_bytes = std::as_bytes(std::span(&size, 1));
  std::copy(size_bytes.begin(), size_bytes.end(), all.begin());
  for (std::size_t p = 0; p < digests.size(); ++p)
    std::copy(digests[p].begin(), digests[p].end(),
              all.begin() + static_cast<std::ptrdiff_t>(sizeof size + p * sizeof(Digest)));
  Digest digest;
  if (!done || !sha256(all, digest)) return std::nullopt;
  return digest;
}

std::optional<Digest> digest_of(const InputFile& file, std::uint64_t from) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), &EVP_MD_CTX_free);
  if (!context || EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) != 1) return std::nullopt;
  std::vector<std::byte> piece(std::size_t{1} << 18);
  while (true) {
    const auto received = file.read_at(from, piece);
    if (!received) return std::nullopt;
    if (*received == 0) break;
    if (EVP_DigestUpdate(context.get(), piece.data(), *received) != 1) return std::nullopt;
    from += *received;
  }
  Digest digest;
  if (EVP_DigestFinal_ex(context.get(), reinterpret_cast<unsigned char*>(digest.data()), nullptr) != 1)
    return std::nullopt;
  return digest;
}

}  // namespace palpate::cache
