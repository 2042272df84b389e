#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "palpate/base/result.h"
#include "palpate/openigtlink/messages.h"

/// Decoding of what clients send to a server that publishes images: requests, whose bodies are skipped, and
/// any other message, which is ignored.
namespace palpate::igtl {

/// Request of a client.
enum class Request : std::uint8_t {
  kLabelList,    ///< GET_LBMETA
  kImageList,    ///< GET_IMGMETA
  kImage,        ///< GET_IMAGE
  kStartImages,  ///< STT_IMAGE: an image after each of its changes
  kStopImages,   ///< STP_IMAGE
};

/// Decodes the requests in a client's stream.
class RequestReader {
 public:
  /// @param name  name in the message's header, raw bytes: of the image, or empty
  using OnRequest = std::function<void(Request request, const std::string& name)>;

  RequestReader();
  /// Errors: kBadInput if the input is not OpenIGTLink; the reader is then unusable.
  Result<void> consume(std::span<const std::uint8_t> bytes, const OnRequest& on_request);

 private:
  MessageSplitter messages_;
};

}  // namespace palpate::igtl
