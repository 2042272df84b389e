#include <sys/stat.h>

#include <openssl/ssl.h>

#include <algorithm>
#include <array>
#include <boost/asio/basic_socket_acceptor.hpp>
#include <boost/asio/basic_waitable_timer.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/v6_only.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/core/flat_static_buffer.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <concepts>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/base/file.h"
#include "palpate/server/fresh_socket.h"
#include "server/transport.h"

namespace palpate::server {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using net::ip::tcp;
using ErrorCode = beast::error_code;

// data that the kernel holds for a slow reader would be outdated on arrival
constexpr int kSendBuffer_bytes = 16 << 10;
constexpr auto kAcceptAgain = std::chrono::milliseconds(100);
// forward secrecy and authenticated encryption only
constexpr const char *kCiphers12 = "ECDHE+AESGCM:ECDHE+CHACHA20:!aNULL",
                     *kCiphers13 =
                         "TLS_AES_256_GCM_SHA384:TLS_CHACHA20_POLY1305_SHA256:TLS_AES_128_GCM_SHA256";

/// Type-erased completion handler. Beast's and TLS's composed operations are templates over their handler;
/// with this single handler type each of them is compiled once.
template <class... Args>
class AnyHandler {
 public:
  template <class Handler>
  requires(!std::same_as<std::decay_t<Handler>, AnyHandler>) explicit AnyHandler(Handler&& handler)
      : held_(std::make_unique<Held<std::decay_t<Handler>>>(std::forward<Handler>(handler))) {}

  void operator()(Args... args) {
    const auto held = std::move(held_);
    held->call(args...);
  }

 private:
  struct Holder {
    virtual ~Holder() = default;
    virtual void call(Args... args) = 0;
  };
  template <class Handler>
  struct Held : Holder {
    explicit Held(Handler&& handler) : handler_(std::move(handler)) {}
    explicit Held(const Handler& handler) : handler_(handler) {}
    void call(Args... args) override { handler_(args...); }
    Handler handler_;
  };
  std::unique_ptr<Holder> held_;
};
using TransferHandler = AnyHandler<ErrorCode, std::size_t>;
using DoneHandler = AnyHandler<ErrorCode>;

/// Up to eight buffers of any buffer sequence; the rest is left to the next write.
class Pieces {
 public:
  using value_type = net::const_buffer;
  using const_iterator = const value_type*;

  template <class Buffers>
  explicit Pieces(const Buffers& buffers, std::size_t max_bytes = std::numeric_limits<std::size_t>::max()) {
    const auto end = net::buffer_sequence_end(buffers);
    for (auto at = net::buffer_sequence_begin(buffers); at != end && count_ < pieces_.size(); ++at) {
      const net::const_buffer piece = net::buffer(net::const_buffer(*at), max_bytes);
      max_bytes -= piece.size();
      if (piece.size() > 0) pieces_[count_++] = piece;
    }
  }
  const_iterator begin() const { return pieces_.data(); }
  const_iterator end() const { return pieces_.data() + count_; }

 private:
  std::array<net::const_buffer, 8> pieces_;
  std::size_t count_ = 0;
};

template <class Buffers>
net::mutable_buffer first_of(const Buffers& buffers) {
  const auto end = net::buffer_sequence_end(buffers);
  for (auto at = net::buffer_sequence_begin(buffers); at != end; ++at)
    if (const net::mutable_buffer buffer(*at); buffer.size() > 0) return buffer;
  return {};
}

/// Byte stream of one connection, in the clear or by TLS. A single type of stream, buffers and handler, so
/// that the layers above (HTTP, WebSocket) and below (TCP, TLS) are compiled once.
class Stream {
 public:
  using Socket = net::basic_stream_socket<tcp, net::io_context::executor_type>;
  using executor_type = Socket::executor_type;

  /// @param tls  null: in the clear
  Stream(Socket socket, net::ssl::context* tls) : socket_(std::move(socket)) {
    if (tls) tls_.emplace(socket_, *tls);
  }

  executor_type get_executor() noexcept { return socket_.get_executor(); }
  Socket& socket() { return socket_; }
  bool is_tls() const { return tls_.has_value(); }

  template <class Handler>
  void async_handshake(Handler&& handler) {
    tls_->async_handshake(net::ssl::stream_base::server, DoneHandler(std::forward<Handler>(handler)));
  }
  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    read_some(first_of(buffers), TransferHandler(std::forward<Handler>(handler)));
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    write_some(Pieces(buffers), TransferHandler(std::forward<Handler>(handler)));
  }
  void close() {
    ErrorCode ignored;
    socket_.close(ignored);
  }

 private:
  void read_some(net::mutable_buffer buffer, TransferHandler handler) {
    if (tls_)
      tls_->async_read_some(buffer, std::move(handler));
    else
      socket_.async_read_some(buffer, std::move(handler));
  }
  void write_some(const Pieces& pieces, TransferHandler handler) {
    if (tls_)
      tls_->async_write_some(pieces, std::move(handler));
    else
      socket_.async_write_some(pieces, std::move(handler));
  }
  void end_politely(beast::role_type role, DoneHandler handler) {
    if (tls_)
      tls_->async_shutdown(std::move(handler));
    else
      websocket::async_teardown(role, socket_, std::move(handler));
  }

  // found by Beast by argument-dependent lookup to end a connection
  template <class Handler>
  friend void async_teardown(beast::role_type role, Stream& stream, Handler&& handler) {
    stream.end_politely(role, DoneHandler(std::forward<Handler>(handler)));
  }
  friend void beast_close_socket(Stream& stream) { stream.close(); }

  Socket socket_;
  std::optional<net::ssl::stream<Socket&>> tls_;
};

IpAddress address_of(const net::ip::address& address) {
  if (address.is_v4()) return IpAddress(address.to_v4().to_bytes());
  const net::ip::address_v6 v6 = address.to_v6();
  return IpAddress(v6.to_bytes(), static_cast<std::uint32_t>(v6.scope_id()));
}

net::ip::address address_of(const IpAddress& address) {
  if (address.is_v6()) return net::ip::address_v6(address.bytes(), address.scope_id());
  net::ip::address_v4::bytes_type v4;
  std::copy_n(address.bytes().begin(), v4.size(), v4.begin());
  return net::ip::address_v4(v4);
}

std::string_view view(beast::string_view text) {
  return {text.data(), text.size()};
}

using UpgradeRequest = http::request<http::empty_body>;

class BeastWebSocket : public WebSocket, public std::enable_shared_from_this<BeastWebSocket> {
 public:
  BeastWebSocket(std::unique_ptr<Stream> stream, UpgradeRequest request)
      : stream_(std::move(stream)), socket_(*stream_), request_(std::move(request)) {}

  void accept(std::function<void()> on_control, std::function<void(bool)> then) override {
    set_low_latency_options(stream_->socket().native_handle(), kSendBuffer_bytes);
    // time limits are enforced by the hub's periodic check
    socket_.set_option(websocket::stream_base::timeout{websocket::stream_base::none(),
                                                       websocket::stream_base::none(), false});
    socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
      response.set(http::field::sec_websocket_protocol,
                   beast::string_view(kSubprotocol.data(), kSubprotocol.size()));
      response.erase(http::field::server);
    }));
    socket_.read_message_max(kMaxMessage_bytes);
    socket_.auto_fragment(false);
    on_control_ = std::move(on_control);
    // Beast calls this in the middle of a read, where no close may begin
    socket_.control_callback([this](websocket::frame_type, beast::string_view) {
      net::post(stream_->get_executor(), [self = shared_from_this()] { self->on_control_(); });
    });
    socket_.async_accept(request_, [self = shared_from_this(), then = std::move(then)](ErrorCode failed) {
      self->request_ = {};
      then(!failed);
    });
  }

  void read(std::function<void(Read, std::string_view)> then) override {
    input_.consume(input_.size());
    socket_.async_read(input_,
                       [self = shared_from_this(), then = std::move(then)](ErrorCode failed, std::size_t) {
                         const auto bytes = self->input_.data();
                         then(self->outcome(failed), {static_cast<const char*>(bytes.data()), bytes.size()});
                       });
  }

  void write(std::string_view bytes, bool is_binary, std::function<void(bool)> then) override {
    socket_.binary(is_binary);
    socket_.async_write(net::const_buffer(bytes.data(), bytes.size()),
                        [self = shared_from_this(), then = std::move(then)](ErrorCode failed, std::size_t) {
                          then(!failed);
                        });
  }

  void close(std::uint16_t code, std::function<void()> then) override {
    socket_.async_close(websocket::close_reason(static_cast<websocket::close_code>(code)),
                        [self = shared_from_this(), then = std::move(then)](ErrorCode) { then(); });
  }

  void drop() override { stream_->close(); }

 private:
  Read outcome(ErrorCode failed) const {
    if (!failed) return socket_.got_binary() ? Read::kBinary : Read::kText;
    const ErrorCode closed = websocket::error::closed;
    return failed != closed && failed.category() == closed.category() ? Read::kMalformed : Read::kClosed;
  }

  std::unique_ptr<Stream> stream_;
  websocket::stream<Stream&, false> socket_;
  UpgradeRequest request_;
  beast::flat_static_buffer<kMaxMessage_bytes> input_;
  std::function<void()> on_control_;
};

/// Input buffer for request heads. Beast unfolds multi-line header fields while parsing, but a proxy might
/// not and would then see a different header, so the bytes are checked before they are consumed.
class HeadBuffer : public beast::flat_static_buffer<2 * HttpConnection::kMaxHead_bytes> {
 public:
  void consume(std::size_t bytes) {
    const std::string_view used(static_cast<const char*>(data().data()), std::min(bytes, size()));
    for (std::size_t end = used.find('\n'); end != std::string_view::npos; end = used.find('\n', end + 1))
      is_folded_ =
          is_folded_ || used.substr(end + 1).starts_with(' ') || used.substr(end + 1).starts_with('\t');
    flat_static_buffer::consume(bytes);
  }
  /// Whether a line consumed since begin_head() began with white space.
  bool is_folded() const { return is_folded_; }
  void begin_head() { is_folded_ = false; }

 private:
  bool is_folded_ = false;
};

class BeastHttp : public HttpConnection, public std::enable_shared_from_this<BeastHttp> {
 public:
  explicit BeastHttp(std::unique_ptr<Stream> stream) : stream_(std::move(stream)) {
    ErrorCode failed;
    const tcp::endpoint remote = stream_->socket().remote_endpoint(failed);
    if (!failed) {
      peer_ = address_of(remote.address()).text();
      from_ = block_of(address_of(remote.address()));
    }
    const tcp::endpoint local = stream_->socket().local_endpoint(failed);
    if (!failed) local_address_ = address_of(local.address()).unmapped().without_scope().text();
  }

  const std::string& peer() const override { return peer_; }
  const AddressBlock& from() const override { return from_; }
  const std::string& local_address() const override { return local_address_; }

  bool is_tls() const override { return stream_->is_tls(); }
  void handshake(std::function<void(bool)> then) override {
    stream_->async_handshake(
        [self = shared_from_this(), then = std::move(then)](ErrorCode failed) { then(!failed); });
  }

  void read_head(std::function<void(Head)> then) override {
    parser_.emplace();
    input_.begin_head();
    parser_->header_limit(kMaxHead_bytes);
    // bodies are refused once the sender is authenticated, and never read
    parser_->body_limit(std::numeric_limits<std::uint64_t>::max());
    http::async_read_header(
        *stream_, input_, *parser_,
        [self = shared_from_this(), then = std::move(then)](ErrorCode failed, std::size_t head_bytes) {
          // the parser's own limit does not count all line ends
          if (!failed && head_bytes > kMaxHead_bytes) failed = http::error::header_limit;
          if (!failed && self->input_.is_folded()) failed = http::error::bad_value;
          then(outcome(failed));
        });
  }

  HttpRequest request() const override {
    const auto& head = parser_->get();
    HttpRequest request;
    request.method = view(head.method_string());
    request.target = view(head.target());
    request.host = view(head[http::field::host]);
    request.origin = view(head[http::field::origin]);
    request.fetch_site = view(head["Sec-Fetch-Site"]);
    request.authorization = view(head[http::field::authorization]);
    request.accept_encoding = view(head[http::field::accept_encoding]);
    request.if_none_match = view(head[http::field::if_none_match]);
    for (const auto once :
         {http::field::host, http::field::origin, http::field::authorization, http::field::content_length})
      request.ambiguous = request.ambiguous || head.count(once) > 1;
    // request smuggling: if a proxy and this server disagreed about the length of a body, its rest would be
    // taken for the next request
    request.ambiguous = request.ambiguous || head.count(http::field::transfer_encoding) > 0 ||
                        head[http::field::content_length].find(',') != beast::string_view::npos;
    request.has_body = parser_->content_length().value_or(0) > 0;
    request.keep_alive = head.keep_alive();
    request.upgrade = websocket::is_upgrade(head);
    request.subprotocol = http::token_list(head[http::field::sec_websocket_protocol])
                              .exists(beast::string_view(kSubprotocol.data(), kSubprotocol.size()));
    request.local_address = local_address_;
    request.from = from_;
    request.at = std::chrono::steady_clock::now();
    return request;
  }
  bool has_started() const override { return parser_ && parser_->got_some(); }
  bool has_more() const override { return input_.size() > 0; }

  void write(std::string_view head, std::string_view body, std::function<void(std::size_t)> progress,
             std::function<void(bool, std::size_t)> then) override {
    write_next(std::make_unique<Write>(Write{head, body, std::move(progress), std::move(then)}));
  }

  void linger(std::function<void()> then) override {
    async_teardown(beast::role_type::server, *stream_,
                   [self = shared_from_this(), then = std::move(then)](ErrorCode) { then(); });
  }

  void close() override {
    if (stream_) stream_->close();
  }

  std::shared_ptr<WebSocket> upgrade() override {
    return std::make_shared<BeastWebSocket>(std::move(stream_), parser_->release());
  }

 private:
  struct Write {
    std::string_view head, body;  // remaining bytes
    std::function<void(std::size_t)> progress;
    std::function<void(bool, std::size_t)> then;
    std::size_t taken = 0;
  };

  static Head outcome(ErrorCode failed) {
    if (!failed) return Head::kRead;
    const bool malformed = failed.category() == ErrorCode(http::error::bad_version).category();
    if (failed == http::error::end_of_stream || failed == http::error::partial_message || !malformed)
      return Head::kClosed;
    const bool too_long = failed == http::error::header_limit || failed == http::error::buffer_overflow;
    return too_long ? Head::kTooLong : Head::kMalformed;
  }

  void write_next(std::unique_ptr<Write> write) {
    const std::array<net::const_buffer, 2> left{net::const_buffer(write->head.data(), write->head.size()),
                                                net::const_buffer(write->body.data(), write->body.size())};
    stream_->async_write_some(
        Pieces(left, kPart_bytes),
        [self = shared_from_this(), write = std::move(write)](ErrorCode failed, std::size_t used) mutable {
          const std::size_t of_head = std::min(used, write->head.size());
          write->head.remove_prefix(of_head);
          write->body.remove_prefix(used - of_head);
          write->taken += used;
          write->progress(write->taken);
          if (failed || (write->head.empty() && write->body.empty()))
            write->then(!failed, write->taken);
          else
            self->write_next(std::move(write));
        });
  }

  std::unique_ptr<Stream> stream_;
  std::string peer_ = "gone", local_address_;
  AddressBlock from_{};
  HeadBuffer input_;
  std::optional<http::request_parser<http::empty_body>> parser_;
};

class AsioTimer : public Timer {
 public:
  explicit AsioTimer(net::io_context& context) : timer_(context) {}
  void wait_until(Clock::time_point at, std::function<void()> then) override {
    timer_.expires_at(at);
    timer_.async_wait([then = std::move(then)](ErrorCode failed) {
      if (!failed) then();
    });
  }
  void cancel() override { timer_.cancel(); }

 private:
  net::basic_waitable_timer<Clock, net::wait_traits<Clock>, net::io_context::executor_type> timer_;
};

class SslIdentity : public TlsIdentity {
 public:
  SslIdentity() : context_(net::ssl::context::tls_server) {
    // forward secrecy without resumption: whoever obtains the certificate's key later cannot decrypt recorded
    // traffic
    SSL_CTX* const context = context_.native_handle();
    PALPATE_CHECK(SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION) == 1 &&
                  SSL_CTX_set_cipher_list(context, kCiphers12) == 1 &&
                  SSL_CTX_set_ciphersuites(context, kCiphers13) == 1 &&
                  // tickets of TLS 1.3, to which the option below does not apply
                  SSL_CTX_set_num_tickets(context, 0) == 1);
    SSL_CTX_set_options(context, SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    ErrorCode ignored;
    // a key with a passphrase must not prompt at the terminal
    context_.set_password_callback(
        [](std::size_t, net::ssl::context::password_purpose) { return std::string(); }, ignored);
  }
  net::ssl::context& context() { return context_; }

 private:
  net::ssl::context context_;
};

Error bad_tls(const std::filesystem::path& file, const char* what) {
  return {ErrorKind::kBadInput, what, file.string(), "give matching PEM files that you may read"};
}

class TcpListener : public Listener {
 public:
  TcpListener(net::io_context& context, std::shared_ptr<TlsIdentity> tls)
      : tls_(std::static_pointer_cast<SslIdentity>(std::move(tls))),
        acceptor_(context),
        accept_again_(context) {}

  void open(const tcp::endpoint& endpoint, ErrorCode& failed) {
    acceptor_.open(endpoint.protocol(), failed);
    // allows a restart while old connections are in TIME_WAIT
    if (!failed) acceptor_.set_option(net::socket_base::reuse_address(true), failed);
    if (!failed) acceptor_.bind(endpoint, failed);
    if (!failed) acceptor_.listen(net::socket_base::max_listen_connections, failed);
    if (!failed) bound_ = acceptor_.local_endpoint(failed);
    net::ip::v6_only v6_only(false);
    if (!failed && bound_.address().is_v6()) acceptor_.get_option(v6_only, failed);
    is_v6_only_ = v6_only.value();
  }

  IpAddress address() const override { return address_of(bound_.address()); }
  int port() const override { return bound_.port(); }
  bool is_v6_only() const override { return is_v6_only_; }
  void accept(std::function<void(std::shared_ptr<HttpConnection>)> take) override {
    take_ = std::move(take);
    accept_next();
  }
  void close() override {
    ErrorCode ignored;
    acceptor_.close(ignored);
  }

 private:
  void accept_next() {
    acceptor_.async_accept([this](ErrorCode failed, Stream::Socket socket) {
      if (!acceptor_.is_open()) return;
      if (failed) {
        // most likely out of file descriptors: retrying at once would spin
        accept_again_.wait_until(Timer::Clock::now() + kAcceptAgain, [this] {
          if (acceptor_.is_open()) accept_next();
        });
        return;
      }
      // accept the next one first, whatever happens to this connection
      accept_next();
      take_(std::make_shared<BeastHttp>(
          std::make_unique<Stream>(std::move(socket), tls_ ? &tls_->context() : nullptr)));
    });
  }

  std::shared_ptr<SslIdentity> tls_;
  net::basic_socket_acceptor<tcp, net::io_context::executor_type> acceptor_;
  AsioTimer accept_again_;
  tcp::endpoint bound_;
  bool is_v6_only_ = false;
  std::function<void(std::shared_ptr<HttpConnection>)> take_;
};

class AsioLoop : public EventLoop {
 public:
  Result<std::unique_ptr<Listener>> listen(const IpAddress& address, int port,
                                           std::shared_ptr<TlsIdentity> tls) override {
    auto listener = std::make_unique<TcpListener>(context_, std::move(tls));
    ErrorCode failed;
    listener->open({address_of(address), static_cast<std::uint16_t>(port)}, failed);
    if (failed) return Error{ErrorKind::kUnavailable, failed.message(), "", ""};
    return std::unique_ptr<Listener>(std::move(listener));
  }
  std::unique_ptr<Timer> timer() override { return std::make_unique<AsioTimer>(context_); }
  void post(std::function<void()> job) override { net::post(context_, std::move(job)); }
  void run() override { context_.run(); }
  void stop() override { context_.stop(); }
  bool is_stopped() const override { return context_.stopped(); }

 private:
  net::io_context context_{1};
};

}  // namespace

Result<std::shared_ptr<TlsIdentity>> TlsIdentity::read(const std::filesystem::path& certificate_file,
                                                       const std::filesystem::path& key_file) {
  auto identity = std::make_shared<SslIdentity>();
  constexpr std::size_t kMaxPemBytes = std::size_t{1} << 20;
  ErrorCode failed;
  const auto certificate = read_file(certificate_file, kMaxPemBytes);
  if (!certificate) return certificate.error();
  identity->context().use_certificate_chain(net::buffer(*certificate), failed);
  if (failed) return bad_tls(certificate_file, "holds no readable certificate");
  const auto key = read_file(key_file, kMaxPemBytes);
  if (!key) return key.error();
  struct stat status;
  if (::stat(key_file.c_str(), &status) == 0 && (status.st_mode & S_IRWXO) != 0)
    return Error{
        ErrorKind::kBadInput, "every account of this machine can read or change this key", key_file.string(),
        "run chmod 600 on it; if another account may have read it, create a new key and certificate"};
  identity->context().use_private_key(net::buffer(*key), net::ssl::context::pem, failed);
  if (failed) return bad_tls(key_file, "holds no readable key for that certificate");
  return std::shared_ptr<TlsIdentity>(std::move(identity));
}

std::unique_ptr<EventLoop> EventLoop::make() {
  return std::make_unique<AsioLoop>();
}

}  // namespace palpate::server
