#include "haply/connection.h"

#include <poll.h>

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
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

// where nobody listens that is known at once
constexpr auto kConnectPatience = std::chrono::seconds(2);
constexpr auto kSendPatience = std::chrono::milliseconds(10);
// more than the state of as many devices as there may be
constexpr std::size_t kMostMessage_bytes = 64 << 10, kMostAnswer_bytes = 8 << 10;

Clock::time_point at(std::int64_t ns) {
  return Clock::time_point(std::chrono::nanoseconds(ns));
}

// runs what was begun until it is done; false: it is not by then, and was cancelled by closing
template <class Done>
bool run_until(asio::io_context& context, tcp::socket& socket, Clock::time_point until, const Done& done) {
  context.restart();
  while (!done() && context.run_one_until(until) > 0) {
  }
  if (done()) return true;
  boost::system::error_code ignored;
  socket.close(ignored);
  context.restart();
  // handlers refer to what their caller holds
  context.run();
  return false;
}

bool connect(asio::io_context& context, tcp::socket& socket, const std::string& host, std::uint16_t port,
             Clock::time_point until) {
  boost::system::error_code bad;
  const auto address = asio::ip::make_address(host, bad);
  if (bad) return false;
  bool done = false;
  boost::system::error_code failed;
  socket.async_connect(tcp::endpoint(address, port), [&](const boost::system::error_code& error) {
    failed = error;
    done = true;
  });
  if (!run_until(context, socket, until, [&] { return done; }) || failed) return false;
  // without it a small message waits for the one before it to be acknowledged
  socket.set_option(tcp::no_delay(true), bad);
  return !bad;
}

/// The body of a 200, empty for everything else.
std::string http_get(const std::string& host, std::uint16_t port, const char* target) try {
  asio::io_context context(1);
  tcp::socket socket(context);
  const auto until = Clock::now() + kConnectPatience;
  if (!connect(context, socket, host, port, until)) return "";
  beast::http::request<beast::http::empty_body> request(beast::http::verb::get, target, 11);
  request.set(beast::http::field::host, host + ":" + std::to_string(port));
  request.set(beast::http::field::connection, "close");
  beast::flat_buffer buffer;
  beast::http::response_parser<beast::http::string_body> answer;
  answer.body_limit(kMostAnswer_bytes);
  bool done = false, fine = false;
  beast::http::async_write(socket, request, [&](const boost::system::error_code& error, std::size_t) {
    if (error) {
      done = true;
      return;
    }
    beast::http::async_read(socket, buffer, answer,
                            [&](const boost::system::error_code& failed, std::size_t) {
                              done = true;
                              fine = !failed;
                            });
  });
  if (!run_until(context, socket, until, [&] { return done; })) return "";
  return fine && answer.get().result() == beast::http::status::ok ? answer.get().body() : "";
} catch (const boost::system::system_error&) {
  // no more handles
  return "";
}

Error not_there(const HaplySettings& settings) {
  const std::string place = settings.host + ":" + std::to_string(settings.port);
  return {ErrorKind::kUnavailable, "no Inverse Service answers at " + place, "haply",
          "install the Inverse Service from Haply's pages for developers (develop.haply.co), start it, and "
          "plug the Inverse3 in"};
}

}  // namespace

Result<ServiceVersion> find_service(const HaplySettings& settings) {
  // a newer service answers where its WebSocket is, the older ones at a port of their own
  struct Place {
    std::uint16_t port;
    const char* target;
  };
  for (const Place& place : {Place{settings.port, "/3.5/version"}, Place{settings.port, "/version"},
                             Place{settings.old_http_port, "/3.0/version"}})
    if (const auto version = parse_version(http_get(settings.host, place.port, place.target)))
      return *version;
  return not_there(settings);
}

/// A socket for Beast's blocking calls, which end when their time is over. Every tick waits for an answer,
/// and Asio's reactor would add a system call and its handlers to each.
class TimedSocket {
 public:
  /// Nothing came in time. Beast has changed nothing then and can be asked again, which it cannot after an
  /// error.
  struct NothingYet {};
  using executor_type = tcp::socket::executor_type;

  explicit TimedSocket(asio::io_context& context) : socket_(context) {}
  executor_type get_executor() { return socket_.get_executor(); }
  tcp::socket& socket() { return socket_; }
  void wait_until(Clock::time_point until) { until_ = until; }

  template <class Buffers>
  std::size_t read_some(const Buffers& buffers, boost::system::error_code& error) {
    if (!wait_for(POLLIN)) throw NothingYet();
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
  /// Beast closes a failed connection by this.
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
  /// False: the time is over.
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

class Connection::Stream {
 public:
  Stream() : context_(1), stream_(context_) {}

  bool open(const HaplySettings& settings, std::uint16_t port) try {
    const auto until = Clock::now() + kConnectPatience;
    TimedSocket& timed = stream_.next_layer();
    boost::system::error_code error;
    if (!connect(context_, timed.socket(), settings.host, port, until)) return false;
    // what waits is wait_for()
    timed.socket().non_blocking(true, error);
    if (error) return false;
    timed.wait_until(until);
    stream_.read_message_max(kMostMessage_bytes);
    stream_.handshake(settings.host + ":" + std::to_string(port), "/", error);
    return !error;
  } catch (const TimedSocket::NothingYet&) {
    return false;
  }

  Received receive(std::string& text, std::int64_t until_ns) {
    if (lost_) return Received::kLost;
    boost::system::error_code error;
    try {
      stream_.next_layer().wait_until(at(until_ns));
      stream_.read(buffer_, error);
    } catch (const TimedSocket::NothingYet&) {
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
  return Error{ErrorKind::kUnavailable, std::string("no connection is to be had: ") + error.what(), "haply",
               "close other programs, or raise the limit of open files (ulimit -n)"};
}

Connection::Received Connection::receive(std::string& text, std::int64_t until_ns) {
  return stream_->receive(text, until_ns);
}

bool Connection::send(std::string_view text) {
  return stream_->send(text);
}

}  // namespace palpate::haply
