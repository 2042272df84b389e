#pragma once

#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/bind_handler.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <optional>
#include <string>
#include <utility>

#include "link/guess_limit.h"

namespace palpate::link {

namespace net = boost::asio;
namespace beast = boost::beast;
using ErrorCode = beast::error_code;

/// The bytes of one connection, in the clear or by TLS: one type, so that what is built upon it (HTTP,
/// WebSocket) is compiled once. All of it on the server's thread.
class Stream {
 public:
  using Socket = net::basic_stream_socket<net::ip::tcp, net::io_context::executor_type>;
  using executor_type = Socket::executor_type;

  /// @param tls  outlives the stream; nullptr: in the clear
  Stream(Socket socket, net::ssl::context* tls) : socket_(std::move(socket)) {
    if (tls) tls_.emplace(socket_, *tls);
  }

  executor_type get_executor() noexcept { return socket_.get_executor(); }
  Socket& socket() { return socket_; }
  bool is_tls() const { return tls_.has_value(); }

  template <class Handler>
  void async_handshake(Handler&& handler) {
    tls_->async_handshake(net::ssl::stream_base::server, std::forward<Handler>(handler));
  }
  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (tls_)
      tls_->async_read_some(buffers, std::forward<Handler>(handler));
    else
      socket_.async_read_some(buffers, std::forward<Handler>(handler));
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (tls_)
      tls_->async_write_some(buffers, std::forward<Handler>(handler));
    else
      socket_.async_write_some(buffers, std::forward<Handler>(handler));
  }
  /// Says that nothing more will be written.
  void end_writing() {
    ErrorCode ignored;
    socket_.shutdown(net::socket_base::shutdown_send, ignored);
  }
  /// Ends everything that is going on, with an error for each.
  void close() {
    ErrorCode ignored;
    socket_.close(ignored);
  }

 private:
  Socket socket_;
  std::optional<net::ssl::stream<Socket&>> tls_;

  template <class Handler>
  friend void async_teardown(beast::role_type role, Stream& stream, Handler&& handler) {
    if (stream.tls_)
      stream.tls_->async_shutdown(std::forward<Handler>(handler));
    else
      beast::websocket::async_teardown(role, stream.socket_, std::forward<Handler>(handler));
  }
  friend void teardown(beast::role_type, Stream& stream, ErrorCode& error) {
    error = {};
    stream.close();
  }
  friend void beast_close_socket(Stream& stream) { stream.close(); }
};

/// The other side, numeric, for the log.
inline std::string peer_of(Stream& stream) {
  ErrorCode failed;
  const auto endpoint = stream.socket().remote_endpoint(failed);
  return failed ? "gone" : endpoint.address().to_string();
}

inline AddressBlock block_of(Stream& stream) {
  ErrorCode failed;
  const auto endpoint = stream.socket().remote_endpoint(failed);
  return failed ? AddressBlock{} : block_of(endpoint.address());
}

}  // namespace palpate::link
