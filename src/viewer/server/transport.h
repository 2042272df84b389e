#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "palpate/base/result.h"
#include "palpate/server/address.h"
#include "server/http_request.h"

/// Network interface of the viewer server. network.cc implements it with Boost.Asio, Boost.Beast and OpenSSL,
/// and is the only source of the server that includes Boost
/// (docs/decisions/archive/0073-one-source-for-beast.md).
///
/// One thread runs the event loop. Everything but EventLoop::post() is called on that thread, and every
/// callback comes from it, never within the call that it was passed to. An operation owns its callback,
/// including captured objects, until the callback has returned or the loop is destroyed.
namespace palpate::server {

/// WebSocket subprotocol that viewers request.
inline constexpr std::string_view kSubprotocol = "palpate.v1";

/// One-shot timer. Destruction cancels it.
class Timer {
 public:
  using Clock = std::chrono::steady_clock;
  virtual ~Timer() = default;
  /// Calls `then` at that time. Replaces an earlier wait, whose callback may still be called if it was
  /// already due.
  virtual void wait_until(Clock::time_point at, std::function<void()> then) = 0;
  virtual void cancel() = 0;
};

/// An open WebSocket, one read and one write at a time.
class WebSocket {
 public:
  /// Maximum length of a viewer's message; a longer one ends the connection.
  static constexpr std::size_t kMaxMessage_bytes = 4096;

  virtual ~WebSocket() = default;
  /// Confirms the upgrade.
  /// @param on_control  called after each ping, pong or close frame, not within another callback
  /// @param then        false: the connection failed
  virtual void accept(std::function<void()> on_control, std::function<void(bool ok)> then) = 0;

  enum class Read : std::uint8_t {
    kText,
    kBinary,
    kClosed,     ///< by the viewer, or the connection failed
    kMalformed,  ///< a frame against the protocol, or a message that is too long
  };
  /// Reads the next message; after a failed read, `text` is the part received.
  /// @param then  `text` is valid until the next read()
  virtual void read(std::function<void(Read outcome, std::string_view text)> then) = 0;
  /// @param bytes  remain valid and unchanged until `then`
  /// @param then   false: the connection failed
  virtual void write(std::string_view bytes, bool is_binary, std::function<void(bool ok)> then) = 0;
  /// Sends a close frame and waits for the viewer's; only after accept().
  /// @param code  of RFC 6455, or 4000 and above
  virtual void close(std::uint16_t code, std::function<void()> then) = 0;
  /// Closes the connection at once; pending operations fail.
  virtual void drop() = 0;
};

/// A connection that speaks HTTP/1.1, one operation at a time.
class HttpConnection {
 public:
  /// Maximum size of a request's head.
  static constexpr std::size_t kMaxHead_bytes = 8192;
  /// Progress of a write is reported at least this often.
  static constexpr std::size_t kPart_bytes = 64 << 10;

  virtual ~HttpConnection() = default;
  /// Numeric address of the peer, for the log; "gone" if the peer disconnected before the accept.
  virtual const std::string& peer() const = 0;
  /// Address block of the peer; all 0 if it had closed.
  virtual const AddressBlock& from() const = 0;
  /// Numeric local address of the connection, as a viewer writes it: without scope, IPv4-mapped as IPv4.
  virtual const std::string& local_address() const = 0;

  virtual bool is_tls() const = 0;
  /// TLS only.
  /// @param then  false: the handshake failed
  virtual void handshake(std::function<void(bool ok)> then) = 0;

  enum class Head : std::uint8_t {
    kRead,
    kTooLong,
    kMalformed,
    kClosed,  ///< by the viewer, or the connection failed
  };
  /// Reads the head of the next request. Its body is never read.
  virtual void read_head(std::function<void(Head outcome)> then) = 0;
  /// Request fields that the head determines; valid until the next read_head() or upgrade().
  virtual HttpRequest request() const = 0;
  /// Whether part of a head has been received since read_head().
  virtual bool has_started() const = 0;
  /// Whether bytes have been received after the head.
  virtual bool has_more() const = 0;

  /// Writes two pieces, of which either may be empty but not both.
  /// @param head, body  remain valid and unchanged until `then`
  /// @param progress    called with the number of bytes that the system has taken so far in this write
  /// @param then        false: the connection failed
  virtual void write(std::string_view head, std::string_view body,
                     std::function<void(std::size_t used)> progress,
                     std::function<void(bool ok, std::size_t used)> then) = 0;
  /// Shuts down sending, and reads and discards input until the viewer closes.
  virtual void linger(std::function<void()> then) = 0;
  /// Closes the connection at once; pending operations fail.
  virtual void close() = 0;
  /// Turns the connection into the requested WebSocket. This object is empty afterwards.
  virtual std::shared_ptr<WebSocket> upgrade() = 0;
};

/// Certificate and private key of a server.
class TlsIdentity {
 public:
  virtual ~TlsIdentity() = default;
  /// Reads two PEM files. Errors: kBadInput, and those of reading a file.
  static Result<std::shared_ptr<TlsIdentity>> read(const std::filesystem::path& certificate,
                                                   const std::filesystem::path& key);
};

/// A bound socket that listens.
class Listener {
 public:
  virtual ~Listener() = default;
  virtual IpAddress address() const = 0;
  virtual int port() const = 0;
  /// Bound to IPv6 without accepting IPv4.
  virtual bool is_v6_only() const = 0;
  /// Passes each new connection to `take` until close().
  virtual void accept(std::function<void(std::shared_ptr<HttpConnection>)> take) = 0;
  virtual void close() = 0;
};

/// Event loop: runs the callbacks of timers, connections and jobs sequentially.
class EventLoop {
 public:
  static std::unique_ptr<EventLoop> make();
  virtual ~EventLoop() = default;

  /// @param port  0: any free port
  /// @param tls   null: in the clear
  /// Error kUnavailable with the system's reason in `what`.
  virtual Result<std::unique_ptr<Listener>> listen(const IpAddress& address, int port,
                                                   std::shared_ptr<TlsIdentity> tls) = 0;
  virtual std::unique_ptr<Timer> timer() = 0;
  /// Schedules `job`. Callable from any thread.
  virtual void post(std::function<void()> job) = 0;
  /// Runs until stop(). Rethrows exceptions of callbacks, and may then be called again.
  virtual void run() = 0;
  virtual void stop() = 0;
  virtual bool is_stopped() const = 0;
};

}  // namespace palpate::server
