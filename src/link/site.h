#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <variant>

#include "link/access.h"
#include "link/payload_store.h"
#include "link/volume_pictures.h"
#include "palpate/link/viewer_server.h"

/// What is served at which address, without a word of sockets.
namespace palpate::link {

/// The parts of a request that decide its answer. Header fields that are not there are empty.
struct HttpRequest {
  std::string_view method, target;
  std::string_view host, origin, fetch_site, authorization, accept_encoding, if_none_match;
  /// What two programs could read in two ways: host, origin, authorization or the length of a body twice, or
  /// a body in another form than its bytes.
  bool ambiguous = false;
  bool has_body = false;
  bool upgrade = false;            ///< to a WebSocket
  bool subprotocol = false;        ///< ours is among those that the viewer speaks
  std::string_view local_address;  ///< where the connection arrived
  AddressBlock from{};             ///< where it came from
  GuessLimit::Clock::time_point at{};
};

struct HttpAnswer {
  int status = 200;
  std::string fields;  ///< header lines of this answer alone, each with its end
  /// Of GET; HEAD has its length alone.
  std::shared_ptr<const std::string> body;
  std::string_view fixed_body;  ///< instead of `body`, of what is compiled in

  std::string_view text() const { return body ? std::string_view(*body) : fixed_body; }
};

/// The answer is a volume that may have to be made first.
struct VolumeWanted {
  PayloadKey key;
  HttpAnswer head;  ///< its body is to be filled in
};

/// The answer is a picture of the volume that has to be made.
struct PictureWanted {
  PictureKey key;
  HttpAnswer head;  ///< its body is to be filled in
};

/// The answer is a WebSocket.
struct Upgrade {};

using SiteAnswer = std::variant<HttpAnswer, VolumeWanted, PictureWanted, Upgrade>;

class Site {
 public:
  /// @param host  outlives the site, as does its scene
  Site(ViewerHost& host, Access access, VolumeFacts facts);

  SiteAnswer answer(const HttpRequest& request);
  Access& access() { return access_; }

  /// The bytes before the body.
  /// @param host  of the request; one that is not served here goes into no answer
  std::string head_of(const HttpAnswer& answer, const HttpRequest& request, bool keep_alive) const;
  /// A refusal, with a line of text that says why.
  static HttpAnswer refusal(int status);

 private:
  HttpAnswer file(std::string_view name, const HttpRequest& request) const;
  HttpAnswer scene(Role role) const;
  SiteAnswer volume(std::string_view path, std::string_view query, const HttpRequest& request) const;
  SiteAnswer picture(std::string_view hash, std::string_view query, const HttpRequest& request) const;

  ViewerHost& host_;
  Access access_;
  const VolumeFacts facts_;
};

/// "Not Found" for 404.
std::string_view reason_of(int status);

}  // namespace palpate::link
