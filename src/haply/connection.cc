#include "haply/connection.h"

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

class Connection::Stream {
 public:
  Stream() : context_(1), socket_(context_) {}
  ~Stream() {
    boost::system::error_code ignored;
    beast::get_lowest_layer(socket_).close(ignored);
    context_.restart();
    context_.run();
  }

  bool open(const HaplySettings& settings, std::uint16_t port) {
    const auto until = Clock::now() + kConnectPatience;
    tcp::socket& socket = beast::get_lowest_layer(socket_);
    if (!connect(context_, socket, settings.host, port, until)) return false;
    socket_.read_message_max(kMostMessage_bytes);
    bool done = false;
    boost::system::error_code failed;
    socket_.async_handshake(settings.host + ":" + std::to_string(port), "/",
                            [&](const boost::system::error_code& error) {
                              failed = error;
                              done = true;
                            });
    return run_until(context_, socket, until, [&] { return done; }) && !failed;
  }

  Received receive(std::string& text, std::int64_t until_ns) {
    if (lost_) return Received::kLost;
    if (!reading_) {
      reading_ = true;
      read_ = false;
      socket_.async_read(buffer_, [this](const boost::system::error_code& error, std::size_t) {
        reading_ = false;
        read_ = !error;
        lost_ = lost_ || error;
      });
    }
    run(at(until_ns), [this] { return !reading_; });
    if (reading_) return Received::kNothing;
    if (!read_) return Received::kLost;
    read_ = false;
    text = beast::buffers_to_string(buffer_.data());
    buffer_.consume(buffer_.size());
    return Received::kMessage;
  }

  bool send(std::string_view text) {
    if (lost_ || writing_) return false;
    writing_ = true;
    // it is sent later where the service does not read
    out_ = text;
    socket_.async_write(asio::buffer(out_), [this](const boost::system::error_code& error, std::size_t) {
      writing_ = false;
      lost_ = lost_ || error;
    });
    run(Clock::now() + kSendPatience, [this] { return !writing_; });
    return !writing_ && !lost_;
  }

 private:
  template <class Done>
  void run(Clock::time_point until, const Done& done) {
    context_.restart();
    while (!done() && context_.run_one_until(until) > 0) {
    }
  }

  asio::io_context context_;
  beast::websocket::stream<tcp::socket> socket_;
  beast::flat_buffer buffer_;
  std::string out_;
  bool reading_ = false, read_ = false, writing_ = false, lost_ = false;
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
