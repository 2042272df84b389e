#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/server/viewer_host.h"

/// Viewer server: lets browsers on this or another machine observe and control a session by HTTP and
/// WebSocket, as specified in docs/reference/viewer-protocol.md. The server depends on neither the servo nor
/// the model: it obtains data from a ViewerHost and passes requests to it.
namespace palpate {

/// Default port of the viewer's page.
inline constexpr int kViewerPort = 8480;

/// Options of ViewerServer::start().
struct ViewerServerOptions {
  std::string address = "127.0.0.1";  ///< Numeric address; any other than loopback requires tokens
  int port = kViewerPort;             ///< 0: any free port
  /// File with lines "control TOKEN", "view TOKEN", "teacher TOKEN" and "learner TOKEN PSEUDONYM", with
  /// tokens of at least 16 printable characters without blanks, and comments that begin with '#'; empty:
  /// none. Weak tokens are reported in `log`, or refused.
  std::filesystem::path token_file;
  std::filesystem::path tls_certificate, tls_key;  ///< PEM files; both or neither
  /// Additional host names under which the server is reached: NAME or, behind a tunnel, NAME:PORT.
  std::vector<std::string> host_names;
  /// Receives viewers' faults, one line each, never including what they sent. Called on the server's thread,
  /// and by start().
  std::function<void(const std::string&)> log;
};

/// Serves the page and the session until it is destroyed. Uses three threads: one for all viewers and one
/// that generates volumes, both at ordinary priority, and one at the lowest priority that renders volume
/// pictures (with helper threads while it does).
class ViewerServer {
 public:
  /// Checks everything that start() would refuse, except whether the port is free; for use before long work.
  /// Logs nothing.
  static Result<void> check(ViewerServerOptions options);
  /// @param host  outlives the server
  /// Errors: kUsage for inconsistent options (an address beyond loopback without tokens, a certificate
  /// without its key); kBadInput for a token file or certificate that cannot be read, with its line;
  /// kUnavailable for an address or port that cannot be bound, or threads that cannot be created.
  static Result<std::unique_ptr<ViewerServer>> start(ViewerHost& host, const ViewerServerOptions& options);
  virtual ~ViewerServer() = default;
  /// "http://127.0.0.1:8480/"; for a server on all addresses, one that other machines can open.
  virtual std::string url() const = 0;
  virtual int port() const = 0;
  virtual int viewers() const = 0;
};

}  // namespace palpate
