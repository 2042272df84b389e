#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <variant>

#include "palpate/server/viewer_host.h"
#include "server/access.h"
#include "server/http_request.h"
#include "server/payload_store.h"
#include "server/redaction.h"
#include "server/scene_json.h"
#include "server/volume_pictures.h"

/// HTTP routing and answers, independent of sockets.
namespace palpate::server {

struct HttpResponse {
  int status = 200;
  std::string fields;  ///< Header lines specific to this answer, each with its line end
  /// Body of a GET; HEAD sends its length only.
  std::shared_ptr<const std::string> body;
  std::string_view fixed_body;  ///< Body that is compiled in; used if `body` is null

  std::string_view text() const { return body ? std::string_view(*body) : fixed_body; }
};

/// Answer with a volume that may have to be generated first.
struct VolumeRequest {
  PayloadKey key;
  HttpResponse head;  ///< Its body is still to be set
};

/// Answer with a picture of the volume that has to be rendered.
struct PictureRequest {
  PictureKey key;
  HttpResponse head;  ///< Its body is still to be set
};

/// Answer with a page of learning curves that has to be generated.
struct CurvesRequest {
  std::string learner;  ///< Pseudonym; empty: all learners
  HttpResponse head;    ///< Its body is still to be set
};

/// Upgrade to a WebSocket.
struct Upgrade {};

using SiteResponse = std::variant<HttpResponse, VolumeRequest, PictureRequest, CurvesRequest, Upgrade>;

/// Facts about a scene's volumes as viewers get them.
/// @param scale  quantisation of its scan
VolumeFacts facts_of(const ViewedScene& scene, const ScanScale& scale);

class Site {
 public:
  /// @param host       outlives the site, as does its scene
  /// @param redaction  applies to learners during a quiz; outlives the site; null: none
  Site(ViewerHost& host, Access access, VolumeFacts facts, const Redaction* redaction = nullptr);

  SiteResponse answer(const HttpRequest& request);
  Access& access() { return access_; }
  /// LiveHost::stores_runs; false for a recording.
  bool stores_runs() const;
  /// Switches the redaction on or off; initially on. On while a quiz is possible and its solution has not
  /// been shown.
  void set_redaction_active(bool active) { redaction_active_ = active; }
  /// Redaction for learners while it is on; null: none.
  const Redaction* redaction() const { return redaction_; }
  /// Redaction that applies to a viewer; null: none.
  const Redaction* redaction_of(const AuthenticatedViewer& who) const {
    return redaction_active_ && !is_permitted(who.role, Permission::kSeeHidden, true) ? redaction_ : nullptr;
  }

  /// Status line and header.
  /// @param host  Host of the request; never echoed unless this server serves it
  std::string head_of(const HttpResponse& answer, const HttpRequest& request, bool keep_alive) const;
  /// Error answer with one line of text.
  /// @param why  empty: the status' reason phrase
  static HttpResponse refusal(int status, const std::string& why = "");

 private:
  HttpResponse file(std::string_view name, const HttpRequest& request) const;
  HttpResponse scene(const AuthenticatedViewer& who) const;
  SiteResponse volume(std::string_view path, std::string_view query, const HttpRequest& request,
                      const AuthenticatedViewer& who) const;
  SiteResponse picture(std::string_view hash, std::string_view query, const HttpRequest& request,
                       const AuthenticatedViewer& who) const;
  SiteResponse curves(const AuthenticatedViewer& who) const;
  /// Hash in the URLs of the data that a viewer receives.
  std::string hash_for(const AuthenticatedViewer& who) const;

  ViewerHost& host_;
  Access access_;
  const VolumeFacts facts_;
  const Redaction* const redaction_;
  bool redaction_active_ = true;
};

/// "Not Found" for 404.
std::string_view reason_of(int status);

}  // namespace palpate::server
