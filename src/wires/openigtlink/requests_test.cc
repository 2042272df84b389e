#include "palpate/openigtlink/requests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace palpate::igtl {
namespace {

using Bytes = std::vector<std::uint8_t>;

// a head as in the specification, and a body of zeros
Bytes message(const std::string& type, const std::string& name, std::uint8_t body_bytes = 0) {
  Bytes bytes(kHeader_bytes + body_bytes, 0);
  bytes[1] = 1;
  std::memcpy(bytes.data() + 2, type.data(), type.size());
  std::memcpy(bytes.data() + 14, name.data(), name.size());
  bytes[49] = body_bytes;
  return bytes;
}

TEST(OpenIgtLinkRequests, AreFoundAmongOtherMessagesInPiecesOfAnyLength) {
  Bytes stream;
  for (const Bytes& part :
       {message("GET_LBMETA", ""), message("STATUS", "Slicer", 30), message("GET_IMGMETA", "any", 7),
        message("GET_IMAGE", "Slice"), message("TRANSFORM", "Tool", 48), message("STT_IMAGE", "Labels", 8),
        message("STP_IMAGE", "Labels"), message("STT_TDATA", "Labels")})
    stream.insert(stream.end(), part.begin(), part.end());
  const std::vector<std::pair<Request, std::string>> expected{{Request::kLabelList, ""},
                                                              {Request::kImageList, "any"},
                                                              {Request::kImage, "Slice"},
                                                              {Request::kStartImages, "Labels"},
                                                              {Request::kStopImages, "Labels"}};
  for (std::size_t piece = 1; piece <= stream.size(); ++piece) {
    RequestReader reader;
    std::vector<std::pair<Request, std::string>> found;
    for (std::size_t at = 0; at < stream.size(); at += piece)
      ASSERT_TRUE(
          reader
              .consume(std::span(stream).subspan(at, std::min(piece, stream.size() - at)),
                       [&](Request request, const std::string& name) { found.emplace_back(request, name); })
              .ok());
    ASSERT_EQ(found, expected) << "pieces of " << piece;
  }
}

TEST(OpenIgtLinkRequests, OtherInputIsRefused) {
  RequestReader reader;
  EXPECT_EQ(reader.consume(Bytes(kHeader_bytes, 0xff), [](Request, const std::string&) {}).error().kind,
            ErrorKind::kBadInput);
}

}  // namespace
}  // namespace palpate::igtl
