#include "server/site.h"

#include <algorithm>
#include <array>
#include <utility>

#include "server/page.h"

namespace palpate::server {
namespace {

constexpr std::string_view kAssets = "/assets/", kVolumes = "/api/volume/", kScene = "/api/scene",
                           kPictures = "/api/picture/", kCurves = "/api/curves", kSocket = "/ws";

std::string field(std::string_view name, std::string_view value) {
  std::string line(name);
  line += ": ";
  line += value;
  return line + "\r\n";
}

std::string in_quotes(std::string_view text) {
  std::string tag = "\"";
  tag += text;
  return tag + "\"";
}

/// Removes and returns the first member of a comma-separated list, without surrounding blanks.
std::string_view next_member(std::string_view& list) {
  std::string_view member = list.substr(0, list.find(','));
  list.remove_prefix(std::min(list.size(), member.size() + 1));
  while (member.starts_with(' ') || member.starts_with('\t')) member.remove_prefix(1);
  while (member.ends_with(' ') || member.ends_with('\t')) member.remove_suffix(1);
  return member;
}

bool knows_tag(std::string_view if_none_match, std::string_view tag) {
  while (!if_none_match.empty()) {
    std::string_view member = next_member(if_none_match);
    if (member.starts_with("W/")) member.remove_prefix(2);
    if (member == "*" || member == tag) return true;
  }
  return false;
}

// accepts "gzip" and "gzip;q=0.5", but not "gzip;q=0"
bool takes_gzip(std::string_view accept_encoding) {
  while (!accept_encoding.empty()) {
    const std::string_view member = next_member(accept_encoding);
    const std::string_view name = member.substr(0, member.find(';'));
    if (name != "gzip" && name != "*") continue;
    const std::size_t weight = member.find("q=");
    return weight == member.npos || member.substr(weight + 2).find_first_of("123456789") != member.npos;
  }
  return false;
}

HttpResponse not_modified(std::string fields) {
  HttpResponse answer;
  answer.status = 304;
  answer.fields = std::move(fields);
  return answer;
}

}  // namespace

std::string_view reason_of(int status) {
  constexpr std::array<std::pair<int, std::string_view>, 17> kReasons{{
      {101, "Switching Protocols"},
      {200, "OK"},
      {304, "Not Modified"},
      {400, "Bad Request"},
      {401, "Unauthorized"},
      {403, "Forbidden"},
      {404, "Not Found"},
      {405, "Method Not Allowed"},
      {408, "Request Timeout"},
      {413, "Content Too Large"},
      {421, "Misdirected Request"},
      {426, "Upgrade Required"},
      {429, "Too Many Requests"},
      {431, "Request Header Fields Too Large"},
      {500, "Internal Server Error"},
      {503, "Service Unavailable"},
      {505, "HTTP Version Not Supported"},
  }};
  for (const auto& [known, reason] : kReasons)
    if (known == status) return reason;
  return "Refused";
}

VolumeFacts facts_of(const ViewedScene& scene, const ScanScale& scale) {
  return {hash_text(scene.content_hash), scale.scale, scale.offset, scale.range,
          needs_wide_labels(*scene.labels)};
}

HttpResponse Site::refusal(int status, const std::string& why) {
  HttpResponse answer;
  answer.status = status;
  answer.fields = field("Content-Type", "text/plain; charset=utf-8") + field("Cache-Control", "no-store");
  if (status == 401) answer.fields += field("WWW-Authenticate", "Bearer");
  if (status == 429) answer.fields += field("Retry-After", "1");
  if (status == 405) answer.fields += field("Allow", "GET, HEAD");
  if (why.empty())
    answer.fixed_body = reason_of(status);
  else
    answer.body = std::make_shared<std::string>(why);
  return answer;
}

Site::Site(ViewerHost& host, Access access, VolumeFacts facts, const Redaction* redaction)
    : host_(host), access_(std::move(access)), facts_(std::move(facts)), redaction_(redaction) {}

SiteResponse Site::answer(const HttpRequest& request) {
  // authentication precedes routing
  if (request.ambiguous) return refusal(400);
  if (!access_.serves(request.host, request.local_address)) return refusal(421);
  if (!access_.is_own_origin(request.origin, request.host)) return refusal(403);
  if (request.method != "GET" && request.method != "HEAD") return refusal(405);
  if (request.has_body) return refusal(413);

  const std::string_view path = request.target.substr(0, request.target.find('?'));
  const std::string_view query = request.target.substr(std::min(request.target.size(), path.size() + 1));
  if (!path.starts_with('/')) return refusal(400);
  if (path == "/") return file("index.html", request);
  if (path.starts_with(kAssets)) return file(path.substr(kAssets.size()), request);

  // Sec-Fetch-Site identifies cross-site requests for which a browser sends no Origin
  if (!request.fetch_site.empty() && request.fetch_site != "same-origin" && request.fetch_site != "none")
    return refusal(403);
  if (path == kSocket) {
    if (!request.upgrade) return refusal(426);
    if (!request.subprotocol || request.method != "GET") return refusal(400);
    return Upgrade{};
  }
  const auto [who, too_many_guesses] =
      access_.admit(Access::bearer(request.authorization), request.from, request.at);
  if (!who) return refusal(too_many_guesses ? 429 : 401);
  if (path == kScene) return scene(*who);
  if (path.starts_with(kVolumes)) return volume(path.substr(kVolumes.size()), query, request, *who);
  if (path.starts_with(kPictures)) return picture(path.substr(kPictures.size()), query, request, *who);
  // no parameter names the learner: the token determines it
  if (path == kCurves && query.empty()) return curves(*who);
  return refusal(404);
}

// lookup by name in a fixed list, so path traversal is impossible
HttpResponse Site::file(std::string_view name, const HttpRequest& request) const {
  const EmbeddedFile* found = find_file(viewer_page(), name);
  if (!found) return refusal(404);
  const std::string tag = in_quotes(found->sha256);
  const std::string fields = field("Cache-Control", "no-cache") + field("ETag", tag);
  if (knows_tag(request.if_none_match, tag)) return not_modified(fields);
  HttpResponse answer;
  answer.fields = field("Content-Type", content_type_of(name)) + fields;
  answer.fixed_body = found->text;
  return answer;
}

HttpResponse Site::scene(const AuthenticatedViewer& who) const {
  HttpResponse answer;
  answer.fields = field("Content-Type", "application/json") + field("Cache-Control", "no-store");
  const Redaction* redaction = redaction_of(who);
  VolumeFacts facts = facts_;
  facts.hash = hash_for(who);
  if (redaction != nullptr) facts.wide_labels = redaction->has_wide_labels();
  answer.body = std::make_shared<std::string>(scene_json(
      redaction != nullptr ? redaction->scene() : host_.scene(),
      redaction != nullptr ? redaction->of(host_.state()) : host_.state(), facts, who, stores_runs()));
  return answer;
}

bool Site::stores_runs() const {
  const LiveHost* const live = host_.live();
  return live != nullptr && live->stores_runs();
}

std::string Site::hash_for(const AuthenticatedViewer& who) const {
  const Redaction* redaction = redaction_of(who);
  return redaction != nullptr ? hash_text(redaction->scene().content_hash) : facts_.hash;
}

SiteResponse Site::curves(const AuthenticatedViewer& who) const {
  const bool all = is_permitted(who.role, Permission::kAllRuns, true);
  if (!all && !is_permitted(who.role, Permission::kOwnRuns, true))
    return refusal(403,
                   "only learners (their own) and teachers may see learning curves: connect with a token for "
                   "learner or teacher");
  if (!stores_runs()) return refusal(404, "no runs are recorded in this session");
  CurvesRequest requested;
  requested.learner = all ? std::string() : who.learner;
  requested.head.fields =
      field("Content-Type", "text/html; charset=utf-8") + field("Cache-Control", "no-store");
  return requested;
}

SiteResponse Site::volume(std::string_view path, std::string_view query, const HttpRequest& request,
                          const AuthenticatedViewer& who) const {
  const std::string_view kind = path.substr(0, path.find('/'));
  const std::string_view hash = path.substr(std::min(path.size(), kind.size() + 1));
  const bool labels = kind == "labels", scan = kind == "scan" && host_.scene().scan;
  if (!(labels || scan) || hash != hash_for(who)) return refusal(404);
  if (!query.empty() && query != "shrink=1" && query != "shrink=2" && query != "shrink=4")
    return refusal(404);

  VolumeRequest requested;
  requested.key.labels = labels;
  requested.key.redacted = labels && redaction_of(who) != nullptr;
  requested.key.shrink = query.empty() ? 1 : query.back() - '0';
  requested.key.gzip = labels && takes_gzip(request.accept_encoding);
  std::string name = hash_for(who) + (labels ? "-labels-" : "-scan-") + std::to_string(requested.key.shrink);
  if (requested.key.gzip) name += "-gzip";
  const std::string fields = field("Cache-Control", "private, max-age=31536000, immutable") +
                             field("ETag", in_quotes(name)) + field("Vary", "Accept-Encoding, Authorization");
  if (knows_tag(request.if_none_match, in_quotes(name))) return not_modified(fields);
  requested.head.fields = field("Content-Type", "application/octet-stream") + fields;
  if (requested.key.gzip) requested.head.fields += field("Content-Encoding", "gzip");
  return requested;
}

SiteResponse Site::picture(std::string_view hash, std::string_view query, const HttpRequest& request,
                           const AuthenticatedViewer& who) const {
  const ViewedScene& scene = host_.scene();
  if (hash != hash_for(who) || scene.labels->geometry().voxel_count() > PictureStore::kMaxVoxels)
    return refusal(404);
  const Redaction* redaction = redaction_of(who);
  auto key =
      parse_picture_query(query, (redaction != nullptr ? redaction->scene() : scene).structures.size());
  if (!key) return refusal(400);
  key->redaction = redaction;
  key->gzip = takes_gzip(request.accept_encoding);
  PictureRequest requested;
  requested.head.fields =
      field("Content-Type", "application/octet-stream") + field("Cache-Control", "no-store");
  if (key->gzip) requested.head.fields += field("Content-Encoding", "gzip");
  requested.key = std::move(*key);
  return requested;
}

std::string Site::head_of(const HttpResponse& answer, const HttpRequest& request, bool keep_alive) const {
  // older browsers match a WebSocket's scheme in 'self' only if it is listed explicitly
  std::string socket;
  if (answer.status == 200 || answer.status == 304) {
    socket = access_.tls() ? " wss://" : " ws://";
    socket += request.host;
  }
  std::string head = "HTTP/1.1 " + std::to_string(answer.status) + " ";
  head += reason_of(answer.status);
  head += "\r\n" + answer.fields;
  head +=
      field("Content-Security-Policy",
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
            "connect-src 'self'" +
                socket + "; worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
  head += field("X-Content-Type-Options", "nosniff");
  head += field("Referrer-Policy", "no-referrer");
  head += field("Cross-Origin-Resource-Policy", "same-origin");
  if (answer.status != 304) head += field("Content-Length", std::to_string(answer.text().size()));
  head += field("Connection", keep_alive ? "keep-alive" : "close");
  return head + "\r\n";
}

}  // namespace palpate::server
