#include "haply/connection.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cerrno>
#include <chrono>

#include "palpate/base/clock.h"

namespace palpate::haply {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using tcp = asio::ip::tcp;
using Clock = std::chrono::steady_clock;

// a closed port is detected immediately
constexpr auto kConnectPatience = std::chrono::seconds(2);
constexpr auto kSendPatience = std::chrono::milliseconds(10);
// larger than the state of the maximum number of devices
constexpr std::size_t kMaxMessage_bytes = 64 << 10, kMaxAnswer_bytes = 8 << 10;

Clock::time_point at(std::int64_t ns) {
  return Clock::time_point(std::chrono::nanoseconds(ns));
}

/// Socket with deadlines for Beast's blocking calls. Each tick waits for a reply, and Asio's reactor would
/// add a system call and handler overhead to each.
class TimedSocket {
 public:
  /// Thrown when the deadline passes without data. Beast's state is unchanged then and the call can be
  /// repeated, unlike after an error.
  struct DeadlinePassed {};
  using executor_type = tcp::socket::executor_type;

  explicit TimedSocket(asio::io_context& context) : socket_(context) {}
  executor_type get_executor() { return socket_.get_executor(); }
  void wait_until(Clock::time_point until) { until_ = until; }

  /// Connects; the deadline also applies to subsequent reads and writes. Returns false if the port is closed
  /// or the deadline passes.
  bool connect(const std::string& host, std::uint16_t port, Clock::time_point until) {
    until_ = until;
    boost::system::error_code error;
    const auto address = asio::ip::make_address(host, error);
    if (error) return false;
    const tcp::endpoint endpoint(address, port);
    socket_.open(endpoint.protocol(), error);
    if (error) return false;
    // blocking is done by wait_for()
    socket_.non_blocking(true, error);
    // disables Nagle's algorithm, which would delay a small message until the previous one is acknowledged
    if (!error) socket_.set_option(tcp::no_delay(true), error);
    if (error) return false;
    if (::connect(socket_.native_handle(), endpoint.data(), static_cast<socklen_t>(endpoint.size())) == 0)
      return true;
    if (errno != EINPROGRESS || !wait_for(POLLOUT)) return false;
    int failed = 0;
    socklen_t size = sizeof failed;
    return ::getsockopt(socket_.native_handle(), SOL_SOCKET, SO_ERROR, &failed, &size) == 0 && failed == 0;
  }

  template <class Buffers>
  std::size_t read_some(const Buffers& buffers, boost::system::error_code& error) {
    if (!wait_for(POLLIN)) throw DeadlinePassed();
    return socket_.receive(buffers, 0, error);
  }
  template <class Buffers>
  std::size_t write_some(const Buffers& buffers, boost::system::error_code& error) {
    std::size_t sent = socket_.send(buffers, 0, error);
    while (error == asio::error::would_block && wait_for(POLLOUT)) sent = socket_.send(buffers, 0, error);
    return sent;
  }
  template <class Buffers>
  std::size_t read_some(const Buffers& buffers) {
    return checked([&](auto& error) { return read_some(buffers, error); });
  }
  template <class Buffers>
  std::size_t write_some(const Buffers& buffers) {
    return checked([&](auto& error) { return write_some(buffers, error); });
  }
  /// Called by Beast to close a failed connection.
  friend void teardown(beast::role_type /*role*/, TimedSocket& socket, boost::system::error_code& error) {
    socket.socket_.close(error);
  }

 private:
  template <class Call>
  static std::size_t checked(const Call& call) {
    boost::system::error_code error;
    const std::size_t count = call(error);
    if (error) throw boost::system::system_error(error);
    return count;
  }
  /// Waits for a poll event. Returns false if the deadline passes.
  bool wait_for(short event) {
    pollfd one{socket_.native_handle(), event, 0};
    for (;;) {
      const auto left = std::max(Clock::duration::zero(), until_ - Clock::now());
      const auto whole = std::chrono::duration_cast<std::chrono::seconds>(left);
      const timespec wait{whole.count(), std::chrono::nanoseconds(left - whole).count()};
      const int ready = ppoll(&one, 1, &wait, nullptr);
      if (ready > 0) return true;
      if (ready == 0 || errno != EINTR) return false;
    }
  }

  tcp::socket socket_;
  Clock::time_point until_;
};

/// Body of a response with status 200, otherwise empty.
std::string http_get(const std::string& host, std::uint16_t port, const char* target) try {
  asio::io_context context(1);
  TimedSocket socket(context);
  if (!socket.connect(host, port, Clock::now() + kConnectPatience)) return "";
  const std::string request = std::string("GET ") + target + " HTTP/1.1\r\nHost: " + host + ":" +
                              std::to_string(port) + "\r\nConnection: close\r\n\r\n";
  boost::system::error_code error;
  for (std::string_view left = request; !left.empty();) {
    left.remove_prefix(socket.write_some(asio::const_buffer(left.data(), left.size()), error));
    if (error) return "";
  }
  beast::flat_buffer buffer;
  beast::http::response_parser<beast::http::string_body> answer;
  answer.body_limit(kMaxAnswer_bytes);
  beast::http::read(socket, buffer, answer, error);
  return !error && answer.get().result() == beast::http::status::ok ? answer.get().body() : "";
} catch (const TimedSocket::DeadlinePassed&) {
  return "";
} catch (const boost::system::system_error&) {
  // out of file descriptors
  return "";
}

Error not_there(const HaplySettings& settings) {
  const std::string endpoint = settings.host + ":" + std::to_string(settings.port);
  return {ErrorKind::kUnavailable, "no Inverse Service answers at " + endpoint, "haply",
          "install the Inverse Service from Haply's developer site (develop.haply.co), start it, and connect "
          "the Inverse3"};
}

}  // namespace

Result<ServiceVersion> find_service(const HaplySettings& settings) {
  // newer services answer on the WebSocket port, older ones on a separate port
  struct ServicePath {
    std::uint16_t port;
    const char* target;
  };
  for (const ServicePath& service_path :
       {ServicePath{settings.port, "/3.5/version"}, ServicePath{settings.port, "/version"},
        ServicePath{settings.old_http_port, "/3.0/version"}})
    if (const auto version = parse_version(http_get(settings.host, service_path.port, service_path.target)))
      return *version;
  return not_there(settings);
}

class Connection::Stream {
 public:
  Stream() : context_(1), stream_(context_) {}

  bool open(const HaplySettings& settings, std::uint16_t port) try {
    if (!stream_.next_layer().connect(settings.host, port, Clock::now() + kConnectPatience)) return false;
    boost::system::error_code error;
    stream_.read_message_max(kMaxMessage_bytes);
    stream_.handshake(settings.host + ":" + std::to_string(port), "/", error);
    return !error;
  } catch (const TimedSocket::DeadlinePassed&) {
    return false;
  }

  Received receive(std::string& text, std::int64_t until_ns) {
    if (lost_) return Received::kLost;
    boost::system::error_code error;
    try {
      stream_.next_layer().wait_until(at(until_ns));
      stream_.read(buffer_, error);
    } catch (const TimedSocket::DeadlinePassed&) {
      return Received::kNothing;
    }
    lost_ = static_cast<bool>(error);
    if (lost_) return Received::kLost;
    text = beast::buffers_to_string(buffer_.data());
    buffer_.consume(buffer_.size());
    return Received::kMessage;
  }

  bool send(std::string_view text) {
    if (lost_) return false;
    boost::system::error_code error;
    stream_.next_layer().wait_until(Clock::now() + kSendPatience);
    stream_.write(asio::buffer(text), error);
    lost_ = static_cast<bool>(error);
    return !lost_;
  }

 private:
  asio::io_context context_;
  beast::websocket::stream<TimedSocket> stream_;
  beast::flat_buffer buffer_;
  bool lost_ = false;
};

Connection::Connection(std::unique_ptr<Stream> stream) : stream_(std::move(stream)) {}
Connection::~Connection() = default;

Result<std::unique_ptr<Connection>> Connection::open(const HaplySettings& settings, std::uint16_t port) try {
  auto stream = std::make_unique<Stream>();
  if (!stream->open(settings, port)) return not_there(settings);
  return std::unique_ptr<Connection>(new Connection(std::move(stream)));
} catch (const boost::system::system_error& error) {
  return Error{ErrorKind::kUnavailable, std::string("cannot open a connection: ") + error.what(), "haply",
               "close other programs, or raise the limit of open files (ulimit -n)"};
}

Connection::Received Connection::receive(std::string& text, std::int64_t until_ns) {
  return stream_->receive(text, until_ns);
}

bool Connection::send(std::string_view text) {
  return stream_->send(text);
}

}  // namespace palpate::haply
