#include "palpate/openigtlink/requests.h"

#include <algorithm>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/check.h"

// a client's bytes in one piece, byte by byte, and in pieces of a length that the first byte gives
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using palpate::igtl::Request;
  using Requests = std::vector<std::pair<Request, std::string>>;
  if (size == 0) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  const auto read = [bytes](std::size_t piece) {
    Requests requests;
    palpate::igtl::RequestReader reader;
    bool fine = true;
    for (std::size_t at = 0; at < bytes.size() && fine; at += piece)
      fine = reader
                 .consume(
                     bytes.subspan(at, std::min(piece, bytes.size() - at)),
                     [&](Request request, const std::string& name) { requests.emplace_back(request, name); })
                 .ok();
    return std::pair(fine, requests);
  };
  const auto whole = read(std::max<std::size_t>(bytes.size(), 1));
  PALPATE_CHECK(whole.second.size() <= bytes.size() / palpate::igtl::kHeader_bytes);
  for (const auto& [request, name] : whole.second) PALPATE_CHECK(name.size() <= palpate::igtl::kName_bytes);
  PALPATE_CHECK(read(1) == whole && read(1 + data[0]) == whole);
  return 0;
}
