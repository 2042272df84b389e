#pragma once

#include <functional>
#include <memory>
#include <string>

#include "palpate/base/result.h"
#include "palpate/server/viewer_host.h"

/// Publishes a session by OpenIGTLink, so that 3D Slicer and other programs of image-guided therapy show the
/// tool, the force and the section beside their own data. Clients only receive: nothing that they send
/// changes the session. docs/guide/openigtlink.md lists the messages.
namespace palpate {

/// Port that OpenIGTLink clients expect.
inline constexpr int kOpenIgtLinkPort = 18944;
/// Length of the published force arrow; mm/N.
inline constexpr double kForceArrow_mm_per_N = 10;

struct OpenIgtLinkOptions {
  std::string address = "127.0.0.1";  ///< Numeric address to listen on; the protocol has no access control
  int port = kOpenIgtLinkPort;        ///< 0: any free port
  double rate_hz = 60;                ///< Rate of poses and forces; Hz, 1 ... 1000
  /// Receives one line for each connection that is refused or dropped. Called on the server's thread.
  std::function<void(const std::string&)> log;
};

/// Serves until it is destroyed, on one thread of ordinary priority and a second one that encodes label
/// volumes while a client waits for one.
class OpenIgtLinkServer {
 public:
  /// Maximum number of clients.
  static constexpr int kMaxClients = 16;

  /// @param host  outlives the server
  /// Errors: kUsage if the scene offers tasks, whose hidden structures a client without a role would see;
  /// kBadInput for an address that is not numeric or a rate out of range; kUnavailable for an address or port
  /// that cannot be bound.
  static Result<std::unique_ptr<OpenIgtLinkServer>> start(const ViewerHost& host,
                                                          const OpenIgtLinkOptions& options);
  virtual ~OpenIgtLinkServer() = default;
  virtual int port() const = 0;
  virtual int clients() const = 0;
};

}  // namespace palpate
