#include "palpate/openigtlink/requests.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace palpate::igtl {
namespace {

constexpr std::array<std::pair<std::string_view, Request>, 5> kRequests{
    {{"GET_LBMETA", Request::kLabelList},
     {"GET_IMGMETA", Request::kImageList},
     {"GET_IMAGE", Request::kImage},
     {"STT_IMAGE", Request::kStartImages},
     {"STP_IMAGE", Request::kStopImages}}};

}  // namespace

RequestReader::RequestReader() : messages_([](const std::string&) { return false; }) {}

Result<void> RequestReader::consume(std::span<const std::uint8_t> bytes, const OnRequest& on_request) {
  return messages_.consume(bytes, [&](const MessageHeader& header, std::span<const std::uint8_t>) {
    const auto found =
        std::ranges::find(kRequests, header.type, &std::pair<std::string_view, Request>::first);
    if (found != kRequests.end()) on_request(found->second, header.name);
  });
}

}  // namespace palpate::igtl
