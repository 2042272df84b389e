#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <variant>

#include "link/access.h"
#include "link/http_request.h"
#include "link/payload_store.h"
#include "link/scene_json.h"
#include "link/veil.h"
#include "link/volume_pictures.h"
#include "palpate/link/viewer_server.h"

/// What is served at which address, without a word of sockets.
namespace palpate::link {

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

/// The answer is a page of curves that has to be made.
struct CurvesWanted {
  std::string learner;  ///< whose; empty: everybody's
  HttpAnswer head;      ///< its body is to be filled in
};

/// The answer is a WebSocket.
struct Upgrade {};

using SiteAnswer = std::variant<HttpAnswer, VolumeWanted, PictureWanted, CurvesWanted, Upgrade>;

class Site {
 public:
  /// @param host  outlives the site, as does its scene
  /// @param veil  through which learners see it while a quiz is at hand; outlives the site; null: there is
  /// none
  Site(ViewerHost& host, Access access, VolumeFacts facts, const Veil* veil = nullptr);

  SiteAnswer answer(const HttpRequest& request);
  Access& access() { return access_; }
  /// A quiz is at hand, and nobody has shown what it hides. So it is at first.
  void lay_veil(bool is_laid) { is_veiled_ = is_laid; }
  /// Through which learners see the scene while it is laid; null: there is none.
  const Veil* veil() const { return veil_; }
  /// Through which somebody sees the scene; null: as it is.
  const Veil* veil_of(const Who& who) const {
    return is_veiled_ && !may(who.role, Right::kUnseen, true) ? veil_ : nullptr;
  }

  /// The bytes before the body.
  /// @param host  of the request; one that is not served here goes into no answer
  std::string head_of(const HttpAnswer& answer, const HttpRequest& request, bool keep_alive) const;
  /// A refusal, with a line of text that says why. @param why  empty: the status says it
  static HttpAnswer refusal(int status, const std::string& why = "");

 private:
  HttpAnswer file(std::string_view name, const HttpRequest& request) const;
  HttpAnswer scene(const Who& who) const;
  SiteAnswer volume(std::string_view path, std::string_view query, const HttpRequest& request,
                    const Who& who) const;
  SiteAnswer picture(std::string_view hash, std::string_view query, const HttpRequest& request,
                     const Who& who) const;
  SiteAnswer curves(const Who& who) const;
  /// In the addresses of what somebody sees.
  std::string hash_for(const Who& who) const;

  ViewerHost& host_;
  Access access_;
  const VolumeFacts facts_;
  const Veil* const veil_;
  bool is_veiled_ = true;
};

/// "Not Found" for 404.
std::string_view reason_of(int status);

}  // namespace palpate::link
